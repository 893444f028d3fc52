"""Fiducial markers in pictures, and sheets to print."""
