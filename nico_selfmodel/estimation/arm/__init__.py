"""Kinematics from measured points of the hand."""
