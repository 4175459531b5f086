"""Physical labels for existing clips: contacts, forces, and points on body surfaces."""
