"""How well a start is found in any frame, after a gap, and in situations that are none: `python -m`."""
