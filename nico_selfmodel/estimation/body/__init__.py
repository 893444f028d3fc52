"""Arm and cameras in one problem, and an arm learned from what cameras saw."""
