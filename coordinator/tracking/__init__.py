"""One body through a sequence: start, cut out, filter, estimate; refinement is behind a port."""
