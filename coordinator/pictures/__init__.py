"""Pictures by which a person can judge a run; each is loaded where it is drawn."""
