"""One Nico that sees its hand without rendering: true places are projected into its cameras."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.planning.plans import HOME, commands_of_angles
from nico_selfmodel.planning.visible_workspace import PROJECTED, VisibleWorkspace
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording.observed_body import ObservedBody
from nico_selfmodel.recording.session import record
from nico_selfmodel.systems.looking import MARKER_FRAMES, looking
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.robot import SimulatedRobot
from nico_selfmodel.systems.simulated.sensors import StereoPixels

TRACKERS = {"fiducial": 0.3, "color": 2.0}
"""Noise of a tracked pixel coordinate, independent in both cameras [px]."""
MARKERS = {"fiducial": "fiducial", "color": "finger_tip"}
"""What each tracker looks at."""


@dataclass(frozen=True, eq=False)
class ProjectedNico:
    """Nico's right arm before its wide cameras: its plans, its robots, its recordings."""

    tracker: str
    """`fiducial` or `color`: what on the hand is tracked."""
    workspace: VisibleWorkspace
    """The robot as described."""
    home: NDArray
    """Pose that all sweeps share [rad]. Shape (n,)."""
    arcs: NDArray
    """Lower and upper end of each joint's sweep [rad]. Shape (n, 2)."""

    @classmethod
    def tracked_by(cls, tracker: str = "fiducial") -> "ProjectedNico":
        """Return it.

        Raises:
            ValueError: If there is no such tracker.
        """
        refuse_unknown("tracker", tracker, TRACKERS)
        return _tracked_by(tracker)

    @property
    def arm(self) -> ArmDescription:
        """The arm as described."""
        return self.workspace.arm

    def robot(self, imperfections: Imperfections, seed: int, session: int = 0) -> SimulatedRobot:
        """Return one robot on one day."""
        X_BL, sigma = self.workspace.rig.left.X_WC, TRACKERS[self.tracker]
        return SimulatedRobot.with_cameras(
            self.arm, X_BL, imperfections, seed, session, pixel_sigma=sigma
        )

    def random_poses(
        self, count: int, rng: np.random.Generator, shift: ArrayLike | None = None
    ) -> NDArray:
        """Draw poses in which the hand should be seen [rad]. Shape (count, n).

        Args:
            shift: From the hand's marker to a tool's tip, along the base's axes at q = 0 [m]; the
                bare hand if omitted.
        """
        workspace = self.workspace if shift is None else self.workspace.holding(shift)
        return workspace.random_poses(count, rng)

    def sweeps(self, points: int) -> tuple[list[str], NDArray]:
        """Plan a circle of each joint about home.

        Args:
            points: Poses of each circle, home not counted.

        Returns:
            Sweep labels, length 1 + n * points, and poses [rad].
        """
        labels, poses = [HOME], [self.home]
        for i, joint in enumerate(self.arm.joints):
            low, high = self.arcs[i]
            for value in np.linspace(low, high, points, endpoint=False):
                labels.append(joint)
                poses.append(np.where(np.arange(len(self.home)) == i, value, self.home))
        return labels, np.array(poses)

    def record(
        self,
        robot: SimulatedRobot,
        name: str,
        q: NDArray,
        labels: Sequence[str] | None = None,
        *,
        observed: bool = False,
        seed: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Dataset:
        """Visit planned poses and return what the cameras found.

        A pose is planned with the description and reached as a share of each joint's range between
        its stops, which is all that a robot without a self-model can do.

        Args:
            q: Poses [rad]. Shape (N, n).
            labels: Sweep labels; free poses if omitted. Length N.
            observed: Let its ground truth measure the hand too, in the left camera's frame.
            seed: Kept in the data set.

        Returns:
            The data set; poses in which no camera saw a marker are left out.
        """
        commands = commands_of_angles(robot.joints, self.arm.lower, self.arm.upper, q)
        body = ObservedBody(robot, lambda: robot.ground_truth.p_LH, cameras=1)
        assert isinstance(robot.sensor, StereoPixels)
        return record(
            body if observed else robot,
            list(zip(labels or [""] * len(commands), commands, strict=True)),
            name,
            source="simulated body, "
            + ("hand observed" if observed else "hand seen by its cameras"),
            seed=seed,
            pixel_sigma_px=robot.sensor.sigma or None,
            image_size=self.workspace.rig.left.image_size,
            until_seen=1,
            progress=progress,
        )


@cache
def _tracked_by(tracker: str) -> ProjectedNico:
    """Plan home and sweeps once: nothing in them is random, and nobody can change them."""
    points = {"hand": MARKER_FRAMES[MARKERS[tracker]]}
    arm = ArmDescription.from_urdf("nico", "chest", "right_hand", looking(), points)
    workspace = VisibleWorkspace.of(arm, limits=PROJECTED)
    return ProjectedNico(tracker, workspace, *workspace.home_and_arcs())
