"""An arm of PIC-SERVO boards: homing, limits, motion, what is jammed."""
