"""Bytes of the PIC-SERVO protocol: commands, packets, status."""
