"""Touching one's own body: the arm posed beside it, and ways of its finger to a place."""
