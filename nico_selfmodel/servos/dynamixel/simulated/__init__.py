"""A simulated Dynamixel behind its own bytes."""
