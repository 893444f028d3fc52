"""How joints follow what they are told."""
