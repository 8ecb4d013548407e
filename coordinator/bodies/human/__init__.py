"""People as bodies to track: the human template, its poses, sizes and angles."""
