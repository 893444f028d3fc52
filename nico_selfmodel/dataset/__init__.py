"""What a body sensed: data sets in memory, on disk and from other programs.

A `Dataset` holds encoder readings and, beside them, where a point on the hand was seen. It lives
on disk as a folder (`dataset.yaml` and `samples.csv`). Importers make one from a plain CSV and
from a trajectory export of Vicon Nexus; `sweeps` tells in which poses one joint turned alone.
"""

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.importers.csv_importer import import_csv
from nico_selfmodel.dataset.joint_info import JointInfo

__all__ = [
    "Dataset",
    "JointInfo",
    "import_csv",
]
