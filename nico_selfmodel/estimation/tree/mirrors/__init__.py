"""Mirrors that stand before a body whose cameras move."""
