"""Recordings of any body by any sensors: poses in one table, observations in another."""
