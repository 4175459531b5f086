"""How do I compare? A benchmark of occlusion that is generated from its definition, not downloaded."""
