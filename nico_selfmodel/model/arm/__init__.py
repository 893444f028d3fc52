"""Kinematics: screw axes, Denavit-Hartenberg rows, encoders to radians."""
