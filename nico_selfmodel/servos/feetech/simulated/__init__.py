"""A simulated Feetech servo behind its own bytes."""
