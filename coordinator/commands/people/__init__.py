"""Several people of one recording: a run in a folder for each, and what they have in common."""
