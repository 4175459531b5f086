"""Results of a real detector on rendered images: rates on fully visible people, and errors by cause of occlusion."""
