"""The results of a run: log, track and summary; and their errors."""
