"""WHAT DOES A CLIP LOOK LIKE? A contact sheet, a video, and a recording for the Rerun viewer."""
