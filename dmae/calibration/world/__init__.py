"""The world of a rig: its vertical, its floor and its unit of length, from the people in it."""
