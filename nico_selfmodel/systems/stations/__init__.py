"""Stations: a robot with its cameras or trackers as one Drake diagram."""
