"""How sure a frame makes the tracker of each joint."""
