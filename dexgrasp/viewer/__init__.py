"""Grasps and trials to look at in a browser, live or as one self-contained page; no GL is needed."""
