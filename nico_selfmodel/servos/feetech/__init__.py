"""Feetech servos, STS series, through the package `feetech-servo-sdk`."""
