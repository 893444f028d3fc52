"""Colours as numbers."""

Rgba = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 to 1."""
