"""Where tracking begins: a start file or a search, and a person's measures."""
