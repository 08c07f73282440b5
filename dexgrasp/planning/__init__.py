"""From a cloud or a mesh to a certified grasp."""
