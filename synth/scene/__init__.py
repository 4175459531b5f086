"""What is in a scene, drawn from a seed and built as a MuJoCo model."""
