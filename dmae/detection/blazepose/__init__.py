"""How does BlazePose find people? Candidates in windows, regions of people, landmarks, confidences."""
