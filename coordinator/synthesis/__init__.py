"""Rendered sequences with ground truth."""
