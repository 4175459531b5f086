"""MuJoCo generator of occluded multi-view human motion: config and seed in, `dmae.clip.Clip` out."""
