"""A run's folder while frames are tracked: what is kept of each, read back, and made whole at the end."""
