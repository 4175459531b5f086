"""Review of captured poses: signs of errors, a ranking of doubtful joints, and decisions on them."""
