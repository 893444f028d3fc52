"""A moving robot in Meshcat, and windows."""
