"""What a particle, a request and a frame cost, beside peers."""
