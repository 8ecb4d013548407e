"""Who may be a person in a scene, and which of them is meant."""
