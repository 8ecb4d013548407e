"""Articulated ICP in compiled code: all that is numbers."""
