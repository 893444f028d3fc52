"""What a body knows of itself: chain, servo map, cameras, self-model. Plain numpy."""
