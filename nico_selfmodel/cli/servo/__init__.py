"""`nico-selfmodel servo`: one file a command."""
