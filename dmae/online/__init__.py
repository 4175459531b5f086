"""What now: capture and completion of frames as they come."""
