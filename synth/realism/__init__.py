"""What does a real detector see in rendered pictures? Rates on people in plain sight; errors by what hides a joint."""
