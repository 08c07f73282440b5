"""Signed distance of points to meshes, with gradients."""
