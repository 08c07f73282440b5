"""Objects: the catalogue, shape builders, users' own meshes, rest poses."""
