"""What each setting is worth alone."""
