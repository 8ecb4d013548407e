"""What a person sees and does at a terminal while a command runs."""
