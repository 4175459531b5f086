"""Bodies: proportions, joint limits, landmarks, surfaces, clothes, and their MJCF."""
