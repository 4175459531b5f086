"""How does D-MAE learn? Examples, losses and training, and the calibration of its uncertainty."""
