"""A benchmark of completion under occlusion. Its clips are generated from a definition, not downloaded."""
