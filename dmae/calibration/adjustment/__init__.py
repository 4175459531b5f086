"""Bundle adjustment: the cameras and the joints of tracked people that fit the detections best."""
