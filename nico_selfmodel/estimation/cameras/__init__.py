"""Cameras from views of boards: bundle adjustment, lenses, held-out boards."""
