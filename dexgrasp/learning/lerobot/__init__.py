"""LeRobot: the suite as environments of its scripts, found by its plug-in mechanism."""
