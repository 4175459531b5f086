"""Render images of a scene by OpenGL or by ray casting, and write image files."""
