"""How much is too much: clips corrupted step by step, and every method scored at each step."""
