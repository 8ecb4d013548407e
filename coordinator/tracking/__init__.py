"""Tracks people through a sequence: segmentation, detection, filtering and estimates.

Particles are refined through an interface (`refiner.py`).
"""
