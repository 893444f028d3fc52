"""Chessboards in pictures."""
