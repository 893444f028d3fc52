"""What two cameras saw of an arm, and of boards, as a recording of a tree."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.body.boards import with_boards
from nico_selfmodel.dataset.body.body_dataset import WIDTH, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.conversion import chain_of
from nico_selfmodel.dataset.body.sensors import CAMERA, MarkerInfo, SensorInfo
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.model.cameras.rig_parameters import SIDES

CAMERAS = "cameras"
"""What both cameras share: one standard deviation, for the pixels of a hand tell hardly more."""
BOARDS = f"{CAMERAS} boards"
"""That of corners."""


@dataclass(frozen=True, eq=False)
class SeenBody:
    """Pixels of a hand, and corners of boards, as observations of one tree."""

    pixels: PixelObservations
    """Those of the hand, N rows."""
    data: BodyDataset
    """All of it."""
    row: NDArray
    """Row of `pixels` behind each row of the table, -1 of boards. Shape (T,)."""

    @classmethod
    def of(
        cls, pixels: PixelObservations, dataset: Dataset, boards: BoardViews | None
    ) -> "SeenBody":
        """Lay out what was seen.

        Args:
            pixels: Of the hand.
            boards: Corners, if they take part.
        """
        arm, joints = pixels.arm, chain_of(dataset)
        samples, lead, of = np.unique(arm.sample, return_index=True, return_inverse=True)
        rows = arm.rows[lead]
        seen = pixels.seen[:, ::2].T
        sensor, row = np.nonzero(seen)
        values = np.full((len(row), WIDTH), np.nan)
        values[:, :2] = pixels.pixels.reshape(-1, 2, 2)[row, sensor]
        nobody = np.full(len(row), -1)
        table = ObservationTable(of[row], sensor, arm.marker[row], nobody, values)
        data = BodyDataset(
            dataset.name,
            joints,
            tuple(MarkerInfo(f"hand.{marker}", arm.joints[-1]) for marker in arm.markers),
            tuple(SensorInfo(side, CAMERA, noise=CAMERAS) for side in SIDES),
            samples,
            dataset.encoders[rows],
            table,
            approach=dataset.approach[rows],
        )
        data = data if boards is None else with_boards(data, boards)
        return cls(pixels, data, np.append(row, np.full(len(data.observations) - len(row), -1)))

    def noise_of(self, noise: TreeNoise) -> HandNoise:
        """Return what disturbs the hand's pixels."""
        groups = TreeObservations.of(self.data).noise_groups
        joint = noise.joint[: len(self.pixels.arm.joints)]
        return HandNoise(float(noise.sensor[groups.index(CAMERAS)]), float(joint.max(initial=0.0)))

    def corner_sigma_of(self, noise: TreeNoise) -> float | None:
        """Return the standard deviation of a corner's coordinate [px]; None without boards."""
        groups = TreeObservations.of(self.data).noise_groups
        return float(noise.sensor[groups.index(BOARDS)]) if BOARDS in groups else None
