"""How do I compare? A benchmark of occlusion that is made anew from its definition, not downloaded."""
