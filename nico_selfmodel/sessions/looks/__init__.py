"""What a robot expects to see of itself in mirrors, how its body and arm stand, marks on it."""
