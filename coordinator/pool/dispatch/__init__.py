"""Who refines what: events in, instructions out; pure."""
