"""Scenes of learned arms, cameras, mirrors, and their errors."""
