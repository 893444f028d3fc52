"""Initial guesses of an arm: circle points, axis search, many starts, a described robot."""
