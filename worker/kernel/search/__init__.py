"""Closest visible model points of observed points (step 4c): exact, in tiles, each search from the last."""
