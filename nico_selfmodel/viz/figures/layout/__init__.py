"""Where the panels of a figure stand, and how far what is written about them reaches."""
