"""How one person moves: reading and retargeting of recorded motion, generation of procedural motion."""
