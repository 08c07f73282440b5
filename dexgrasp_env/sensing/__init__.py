"""Depth cameras: sensor model, calibration errors, depth by rays, colours by GL.

Takes a simulation and camera poses; gives images with the errors of a sensor. It segments nothing.
"""
