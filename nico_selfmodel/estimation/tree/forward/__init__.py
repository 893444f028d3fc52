"""The forward model: what sensors of a body show, with every derivative."""
