"""How sure a frame makes the tracker of each joint: evidence, and what it is worth by measurement."""
