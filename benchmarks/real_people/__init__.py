"""How well real people are tracked."""
