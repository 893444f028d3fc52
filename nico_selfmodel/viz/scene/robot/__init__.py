"""The robot around what was learned of it: as it is described, and as it was seen."""
