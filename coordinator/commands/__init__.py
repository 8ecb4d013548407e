"""The commands of `gepf`: one file per command, and their common options."""
