"""Simulated PIC-SERVO boards that answer byte by byte."""
