"""Pixels to points: chessboards, fiducial markers and patches of colour.

A detector takes an image (BGR or grey, 8 bits) and returns what it saw, or a `NotSeen` that says
in words why it saw nothing; it never returns a point that it cannot vouch for. Pixels are OpenCV's:
an integer is the centre of a pixel, u to the right, v down. Only files that cannot be read, and
folders in which nothing was seen at all, raise.
"""
