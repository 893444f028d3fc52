"""`nico-selfmodel learn`: the main job."""
