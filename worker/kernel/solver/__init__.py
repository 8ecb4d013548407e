"""Step 4d: the pose that suits given correspondences best."""
