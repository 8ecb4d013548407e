"""The scene of a fixed camera: floor, walls, background, and the people in front of them."""
