"""Recordings of programs that track people with other libraries: Caliscope, FreeMoCap, MMPose."""
