"""Trains the forest that tells pixels of people from those of things."""
