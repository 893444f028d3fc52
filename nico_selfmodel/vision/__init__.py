"""Pixels to points: chessboards, fiducial markers and patches of colour.

A detector takes an image (BGR or grey, 8 bits) and returns what it saw, or a `NotSeen` that says
in words why it saw nothing; it never returns a point that it cannot vouch for. Pixels are OpenCV's:
an integer is the centre of a pixel, u to the right, v down. Only files that cannot be read, and
folders in which nothing was seen at all, raise.
"""

from nico_selfmodel.vision.chessboard import WINDOW, Board, find_chessboard
from nico_selfmodel.vision.color_blob import color_mask, find_color_blob
from nico_selfmodel.vision.color_model import ColorModel
from nico_selfmodel.vision.image_file import read_image, write_image
from nico_selfmodel.vision.not_seen import NotSeen
from nico_selfmodel.vision.stereo_images import (
    BoardDetections,
    camera_images,
    detect_boards,
    detect_boards_of_one_eye,
    stereo_pairs,
)

__all__ = [
    "WINDOW",
    "Board",
    "BoardDetections",
    "ColorModel",
    "NotSeen",
    "camera_images",
    "color_mask",
    "detect_boards",
    "detect_boards_of_one_eye",
    "find_chessboard",
    "find_color_blob",
    "read_image",
    "stereo_pairs",
    "write_image",
]
