"""Formats of programs that detect people or animals in videos: DeepLabCut, SLEAP, MMPose, MediaPipe and others."""
