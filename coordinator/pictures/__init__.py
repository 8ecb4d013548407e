"""Pictures of a run; each module is loaded when it is needed."""
