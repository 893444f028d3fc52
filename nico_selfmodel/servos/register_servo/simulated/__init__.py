"""Simulated servos with registers: one table, one motion, the same faults for both makes."""
