"""Colour images: keypoints of people in them, by a network."""
