"""Boards on one serial line: addresses, replies, faults."""
