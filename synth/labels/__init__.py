"""Which joints does each camera see, what hides the others, and which forces support people? Rays, images of ids,
forces."""
