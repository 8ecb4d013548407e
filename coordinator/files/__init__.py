"""Files that are whole or absent, and arrays that are checked as they are read."""
