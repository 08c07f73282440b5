"""What the cameras did not see: the other side of an object, guessed from the side that they saw."""
