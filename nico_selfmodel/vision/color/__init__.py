"""Patches of colour in pictures."""
