"""What each command of `gepf` does: one file a command, and the options they share."""
