"""Sessions before mirrors: the hand in them, how the body stands, marks on it."""
