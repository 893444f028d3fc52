"""The outer shape of a body as it was learned, in memory and on disk."""
