"""What a robot does with its finger at its own body, and sees of it."""
