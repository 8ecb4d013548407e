"""The certainty of each joint in a frame."""
