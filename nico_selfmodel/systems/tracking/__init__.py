"""Drake systems that track the hand, and what a self-model predicts of it."""
