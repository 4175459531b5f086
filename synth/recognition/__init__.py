"""What does a real detector find in rendered images? Rates on people in plain sight; errors by cause of occlusion."""
