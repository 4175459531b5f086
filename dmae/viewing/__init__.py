"""Draw clips: a contact sheet, a video, and a recording for the Rerun viewer."""
