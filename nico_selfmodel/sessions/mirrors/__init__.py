"""Sessions before mirrors: the hand in them, acquaintance with the own body, its shape."""
