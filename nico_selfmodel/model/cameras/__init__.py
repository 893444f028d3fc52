"""Cameras, lenses, pairs of cameras, mirrors before them."""
