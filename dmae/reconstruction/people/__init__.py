"""Which people are wanted, which cameras disagree about them, and why there are none."""
