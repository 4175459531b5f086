"""Which people are wanted, which cameras disagree about them or exchange their sides, and why there are none."""
