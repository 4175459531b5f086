"""Capture: from 2D detections of several views to people in 3D (Adaptive Triangulation)."""
