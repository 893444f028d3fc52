"""What the columns of a data set's table are called."""

POINT_COLUMNS = ("x_m", "y_m", "z_m")
PIXEL_COLUMNS = ("left_u", "left_v", "right_u", "right_v")
ENCODER, APPROACH = JOINT_COLUMNS = "encoder", "approach"
"""Columns of a joint, before its name and a point: its reading, and how that last changed."""
SIDES_OF_APPROACH = (-1, 0, 1)
"""A reading fell, nobody knows, it rose, when the joint last moved."""
DEFAULT_MARKER = "hand"
"""The tracked point of rows that name none."""
