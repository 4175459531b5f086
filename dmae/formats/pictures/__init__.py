"""Pictures and videos of recordings: found by camera, joined to a clip."""
