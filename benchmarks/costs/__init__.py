"""Cost of a particle, a request and a frame, compared with other programs."""
