"""Simple solids, and how they are fitted around points."""
