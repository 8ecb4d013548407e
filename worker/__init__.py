"""Refines batches of particles by articulated ICP: no memory between requests, no randomness."""
