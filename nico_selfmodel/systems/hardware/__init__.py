"""Drake systems of real devices: servos, cameras, motion capture."""
