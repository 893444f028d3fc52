"""Boards in pictures: chessboards, ChArUco boards, AprilGrids, grids of circles."""
