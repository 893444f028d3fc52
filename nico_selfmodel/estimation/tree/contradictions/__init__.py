"""What in a recording contradicts what it is said to be."""
