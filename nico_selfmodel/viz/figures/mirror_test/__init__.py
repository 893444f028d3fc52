"""Figures of the mirror test."""
