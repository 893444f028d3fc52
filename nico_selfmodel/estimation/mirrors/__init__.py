"""Mirrors from reflections of the hand, or of boards."""
