"""Refinement by whatever workers there are, over the bus."""
