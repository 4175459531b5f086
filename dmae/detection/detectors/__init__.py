"""Which detectors are there? A file each; to add one, see `dmae.detection.registry`."""
