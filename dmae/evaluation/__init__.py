"""Evaluation: score methods over clips and camera subsets, corrupt clips, and report the results."""
