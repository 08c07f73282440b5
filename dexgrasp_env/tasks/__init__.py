"""The tasks: pick an object up and hold it."""
