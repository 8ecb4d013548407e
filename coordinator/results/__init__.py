"""What a run leaves: its log, its track, its summary, and how good they are."""
