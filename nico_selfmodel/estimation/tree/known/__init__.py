"""What is learned anew in a body that is known, its own errors counted."""
