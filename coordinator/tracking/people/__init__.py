"""Several people at once: one scene and one pool, a follower for each."""
