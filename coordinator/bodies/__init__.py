"""The bodies that can be tracked: a human template, and robots and objects from URDF."""
