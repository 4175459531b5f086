"""The stress matrix: clips are corrupted step by step, and every method is scored at each step."""
