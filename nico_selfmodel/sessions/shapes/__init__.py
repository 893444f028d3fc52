"""The outer shape of links that an arm moves, from pictures that the cameras take of it."""
