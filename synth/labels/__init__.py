"""Which joints does each camera see, and what hides the others? Visibility by rays, silhouettes by images of ids."""
