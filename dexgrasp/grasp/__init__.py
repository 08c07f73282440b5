"""The grasp as an artefact: values, certificate, file, picture, and `verify`, which computes every claim again.

Takes a planned configuration or a grasp file; gives a file and checks, by the limits of `thresholds`, the
margin to the true friction among them. It never looks for a grasp.
"""
