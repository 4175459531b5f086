"""Where is the world of a rig: its vertical, its floor, its unit of length, from the people in it."""
