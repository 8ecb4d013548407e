"""The scene that a static camera sees: floor, walls, background, and whoever stands before them."""
