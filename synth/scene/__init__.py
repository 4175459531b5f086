"""The contents of a scene: drawn from a seed, then built as a MuJoCo model."""
