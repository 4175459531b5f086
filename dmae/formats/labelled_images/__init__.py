"""What does an image show? Labels of the persons in it: joints, their occluders, masks and boxes."""
