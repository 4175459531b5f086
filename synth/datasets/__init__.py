"""How is a data set made and checked? Generate clips, verify them, compare their motion with recordings."""
