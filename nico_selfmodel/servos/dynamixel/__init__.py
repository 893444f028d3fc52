"""Dynamixel servos, X series, protocol 2.0, through the package `dynamixel-sdk`."""
