"""What decides a run's results, so that it is resumed under the same configuration only."""
