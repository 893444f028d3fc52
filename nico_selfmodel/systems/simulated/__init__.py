"""One simulated robot, without Drake: how it was built, how it moves, what sensors say of it."""
