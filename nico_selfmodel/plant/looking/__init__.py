"""How a head turns to a point, and what it learns by looking."""
