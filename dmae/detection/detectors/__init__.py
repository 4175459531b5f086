"""The built-in 2D detectors, one file each. `dmae.detection.registry` says how to add one."""
