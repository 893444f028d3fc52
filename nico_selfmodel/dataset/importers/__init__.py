"""Files of other programs as data sets: CSV tables, Vicon Nexus."""
