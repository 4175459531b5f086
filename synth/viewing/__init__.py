"""What does a clip look like? A contact sheet, a video, and a recording for the Rerun viewer."""
