"""Detection of people with BlazePose: candidates in windows, regions of people, landmarks, confidences."""
