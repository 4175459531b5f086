"""What was not seen: joints that no camera measured, completed."""
