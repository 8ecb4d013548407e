"""Draws the data for the network that tells pixels of people from those of things, and trains it."""
