"""What does a picture show? The persons in it: joints, what hides them, masks and boxes, from the images of ids."""
