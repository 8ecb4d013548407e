"""Refinement of particles by workers on the bus."""
