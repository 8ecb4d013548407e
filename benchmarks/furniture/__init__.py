"""Rendered people on furniture: accuracy, detection, and honesty."""
