"""Captured people: selection, body size, disagreement of cameras, exchanged sides, and diagnosis if there are none."""
