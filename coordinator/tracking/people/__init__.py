"""Several people at once: one scene and one pool, a tracker for each."""
