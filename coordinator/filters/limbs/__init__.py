"""Proposals of single limbs: where they are laid out, reaching for what is seen, and hidden."""
