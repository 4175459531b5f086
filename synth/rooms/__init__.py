"""Rooms and props: MJCF files, meshes, coverings, and the floor that they take."""
