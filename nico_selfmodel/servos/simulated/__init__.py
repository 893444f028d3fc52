"""Simulated devices on a pseudo-terminal or in virtual time, whatever they speak."""
