"""`nico-selfmodel calibrate`: one file a command."""
