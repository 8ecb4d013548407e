"""The poses and clocks of the cameras of a rig, from a person who moves in front of all of them."""
