"""`nico-selfmodel record`: a simulated robot, or a real one, watched as it moves."""
