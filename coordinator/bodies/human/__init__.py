"""Bodies to track: the human template, and descriptions of other articulated bodies."""
