"""Articulated bodies as URDF files: read and written."""
