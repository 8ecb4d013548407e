"""What the tracker takes from a depth frame: the subject's pixels, observed points, the camera's noise."""
