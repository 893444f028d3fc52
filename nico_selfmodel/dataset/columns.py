"""What the columns of a data set's table are called."""

POINT_COLUMNS = ("x_m", "y_m", "z_m")
PIXEL_COLUMNS = ("left_u", "left_v", "right_u", "right_v")
DEFAULT_MARKER = "hand"
"""The tracked point of rows that name none."""
