"""Rendered sequences whose truth is known."""
