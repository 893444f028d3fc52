"""`nico-selfmodel experiment`: one file a chapter of the thesis."""
