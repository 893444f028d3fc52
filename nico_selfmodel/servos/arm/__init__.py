"""An arm of motors of any make: limits, motion, what stops it, what is jammed."""
