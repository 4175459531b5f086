"""Files that programs for biomechanics and animation read: C3D, BVH, GLB."""
