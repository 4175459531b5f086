"""What do images of a scene look like? OpenGL or ray casting, and the files of images."""
