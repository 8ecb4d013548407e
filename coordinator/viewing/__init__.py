"""A run on a time line, in the rerun viewer."""
