"""How one person moves: recorded motion is read and retargeted, procedural motion is made."""
