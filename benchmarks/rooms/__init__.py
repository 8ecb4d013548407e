"""How well people are cut out of rooms and tracked there, beside the same people cut out already."""
