"""What a body sensed: data sets in memory, on disk and from other programs.

A `Dataset` holds encoder readings and, beside them, where a point on the hand was seen. It lives
on disk as a folder (`dataset.yaml` and `samples.csv`). Importers make one from a plain CSV and
from a trajectory export of Vicon Nexus; `sweeps` tells in which poses one joint turned alone.
"""
