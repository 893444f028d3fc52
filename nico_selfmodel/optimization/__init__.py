"""How any estimate is solved for: programs, solvers, losses, uncertainty. Nothing of robots."""
