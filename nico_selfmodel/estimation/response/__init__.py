"""How joints follow their commands: system identification by step responses."""
