"""Servos that are a table of registers on one half-duplex line, as Dynamixel and Feetech are."""
