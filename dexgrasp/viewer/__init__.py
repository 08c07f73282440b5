"""Viewer: grasps and trials in a browser, live or as one self-contained page.

Takes grasps, trials and targets; gives scenes of viser. It needs no GL.
"""
