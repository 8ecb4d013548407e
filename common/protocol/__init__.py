"""What crosses the wire, and where it is found."""
