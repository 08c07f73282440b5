"""LeRobot: the environments for its scripts, found by its plug-in mechanism."""
