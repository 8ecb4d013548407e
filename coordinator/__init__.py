"""One tracker: draws particles, has workers refine them, merges them and records the poses."""
