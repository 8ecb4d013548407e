"""Articulated ICP in compiled code: all numerical computation."""
