"""How a simulated body that sees its own hand is moved: poses in view, sweeps, boards."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model import Chain, StereoRig
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.recording import commands_of_angles
from nico_selfmodel.systems import (
    NICO_CAMERAS,
    TRACKERS,
    HandSighting,
    Imperfections,
    SimulatedBody,
)
from nico_selfmodel.systems.looking import looking
from nico_selfmodel.systems.sweeps_in_view import widest_sweeps

POINTS = {"fiducial": "right_hand_fiducial", "color": "right_finger_tip"}
"""What each tracker looks at."""
_NEAR, _FAR = 0.17, 0.38
"""Distances of the hand from the left eye [m]."""
_MARGIN = 45.0
"""Poses are planned so that the hand stays this far from the images' edges [px]."""
_ARC = np.radians(90.0)
"""Largest arc of a sweep."""


@dataclass(frozen=True, eq=False)
class BodyProtocol:
    """A robot's arm before its eyes, as described: what poses are planned with."""

    arm: ArmDescription
    """The arm."""
    X_BL: NDArray
    """Pose of the left eye in the arm's base. Shape (4, 4)."""
    eyes: StereoRig
    """The eyes as designed."""
    home: NDArray
    """Pose that all sweeps share [rad]. Shape (n,)."""
    arcs: NDArray
    """Lower and upper end of each joint's sweep [rad]. Shape (n, 2)."""

    @classmethod
    def of_nico(cls, tracker: str = "fiducial") -> "BodyProtocol":
        """Return Nico's right arm before its wide eyes.

        Args:
            tracker: `fiducial` or `color`: what on the hand is tracked.

        Raises:
            ValueError: If there is no such tracker.
        """
        if tracker not in POINTS:
            raise ValueError(f"no tracker {tracker!r}; there are {', '.join(POINTS)}")
        return _of_nico(tracker)

    def body(
        self, world: Imperfections, seed: int, session: int = 0, tracker: str = "fiducial"
    ) -> SimulatedBody:
        """Return one individual."""
        return SimulatedBody(
            self.arm.chain,
            self.arm.lower,
            self.arm.upper,
            self.X_BL,
            world,
            seed,
            session,
            pixel_sigma=TRACKERS[tracker],
            eyes=self.eyes,
        )

    def in_view(self, q: NDArray, shift: NDArray | None = None) -> NDArray:
        """Return at which poses both eyes should see the hand well. Shapes (N, n) -> (N,).

        Args:
            q: Joint angles of the description [rad].
            shift: From the hand's marker to a tool's tip, along the base's axes at q = 0 [m].
        """
        p_LH = apply(inverse(self.X_BL), _moved(self.arm.chain, shift).forward(q))
        pixels = self.eyes.project(p_LH)
        limit = np.array([*self.eyes.left.image_size] * 2) - 1.0 - _MARGIN
        distance = np.linalg.norm(p_LH, axis=1)
        with np.errstate(invalid="ignore"):
            inside = ((pixels > _MARGIN) & (pixels < limit)).all(axis=1)
        return inside & (distance > _NEAR) & (distance < _FAR)

    def random_poses(
        self, count: int, rng: np.random.Generator, shift: NDArray | None = None
    ) -> NDArray:
        """Draw poses within the limits, in which the hand should be seen [rad]. (count, n)."""
        found = np.zeros((0, len(self.arm.lower)))
        while len(found) < count:
            q = rng.uniform(self.arm.lower, self.arm.upper, (2000, len(self.arm.lower)))
            found = np.vstack([found, q[self.in_view(q, shift)]])
        return found[:count]

    def sweeps(self, points: int) -> tuple[list[str], NDArray]:
        """Plan a circle of each joint about home.

        Args:
            points: Poses of each circle, home not counted.

        Returns:
            Sweep labels, length 1 + n * points, and poses [rad].
        """
        labels, poses = ["home"], [self.home]
        for i, joint in enumerate(self.arm.joints):
            low, high = self.arcs[i]
            for value in np.linspace(low, high, points, endpoint=False):
                labels.append(joint)
                poses.append(np.where(np.arange(len(self.home)) == i, value, self.home))
        return labels, np.array(poses)

    def record(
        self,
        body: SimulatedBody,
        name: str,
        q: NDArray,
        labels: list[str] | None = None,
        *,
        observed: bool = False,
        seed: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Dataset:
        """Visit planned poses and return what the eyes found.

        A pose is planned with the description and reached as a share of each joint's range between
        its stops, which is all that a body without a self-model can do.

        Args:
            body: The body to move.
            name: Name of the data set.
            q: Poses [rad]. Shape (N, n).
            labels: Sweep labels; free poses if omitted. Length N.
            observed: Let an outsider measure the hand too, in the left eye's frame, for judging.
            seed: Kept in the data set.
            progress: Called after each pose.

        Returns:
            The data set; poses in which no eye saw a marker are left out.
        """
        rows: list[tuple[str, HandSighting, NDArray]] = []
        commands = commands_of_angles(body.joints, self.arm.lower, self.arm.upper, q)
        for done, command in enumerate(commands, start=1):
            sighting, p_LH = body.observe(command)
            if any(np.isfinite(p).any() for p in sighting.pixels.values()):
                rows.append(("" if labels is None else labels[done - 1], sighting, p_LH))
            if progress:
                progress(done, len(q))
        return _dataset(body, name, rows, observed, seed)


@cache
def _of_nico(tracker: str) -> BodyProtocol:
    """Plan home and sweeps once: nothing in them is random, and nobody can change them."""
    points = {"hand": POINTS[tracker]}
    arm = ArmDescription.from_urdf("nico", "chest", "right_hand", looking(), points)
    tree = KinematicTree.from_urdf(arm.urdf)
    X_BL = tree.poses(looking(), "chest", [tree.frame("left_wide_camera")])[0]
    blank = BodyProtocol(arm, X_BL, NICO_CAMERAS, np.zeros(4), np.zeros((4, 2)))
    poses = blank.random_poses(150, np.random.default_rng(0))
    home, arcs = widest_sweeps(arm, poses, blank.in_view, _ARC, ["hand"])
    return replace(blank, home=home, arcs=arcs)


def _moved(chain: Chain, shift: NDArray | None) -> Chain:
    return chain if shift is None else replace(chain, p_WH_zero=chain.p_WH_zero + shift)


def _dataset(
    body: SimulatedBody,
    name: str,
    rows: list[tuple[str, HandSighting, NDArray]],
    observed: bool,
    seed: int | None,
) -> Dataset:
    """Lay sightings out as rows, one for each pose and marker."""
    m = len(body.markers)
    p_LH = np.concatenate([p for _, _, p in rows])
    return Dataset(
        name=name,
        joints=body.joints,
        sample=np.repeat(np.arange(1, len(rows) + 1), m),
        encoders=np.repeat([s.encoders for _, s, _ in rows], m, axis=0),
        pixels=np.array([s.pixels[k] for _, s, _ in rows for k in body.markers]),
        sweep=np.repeat(np.array([label for label, _, _ in rows], dtype=str), m),
        marker=np.tile(np.array(body.markers), len(rows)),
        pixel_sigma_px=body.pixel_sigma or None,
        image_size=body.image_size,
        source="simulated body, " + ("hand observed" if observed else "hand seen by its eyes"),
        seed=seed,
        p_WH_measured=p_LH if observed else np.full_like(p_LH, np.nan),
    )
