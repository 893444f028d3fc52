"""Lenses: which one boards tell, what each leaves, what of it is told at all."""
