"""Which joints does each camera see, what hides the others, and what carries people? Rays, images of ids, forces."""
