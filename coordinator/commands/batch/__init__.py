"""Several recordings over one pool."""
