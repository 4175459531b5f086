"""Which cameras, and which people, fit the detections best: bundle adjustment over the joints of tracked people."""
