"""What is recorded? Skeletons, cameras, clips, their labels and images, and how they are stored."""
