"""Soft correspondences: a density of each observed point over samples of the visible surface."""
