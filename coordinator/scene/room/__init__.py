"""What stands still before the camera: floor, walls, background and furniture."""
