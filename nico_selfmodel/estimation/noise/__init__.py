"""Joint and sensor noise by pose: estimated, whitened with, and expected of new poses."""
