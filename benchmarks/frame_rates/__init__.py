"""How well people are tracked when the camera is slow: fewer frames a second, one particle or many."""
