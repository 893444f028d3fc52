"""What a robot can reach and see by its description: poses in view, home, sweeps, boards."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import JointInfo
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model import Chain, DhTable, SelfModel, ServoMap, StereoRig
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.collisions import CollisionShapes
from nico_selfmodel.systems.simulated_eyes import NICO_CAMERAS
from nico_selfmodel.systems.sweeps_in_view import widest_sweeps
from nico_selfmodel.vision.chessboard import Board

MOUNTS = ("left_wide_camera", "right_wide_camera")
"""Links that carry the eyes."""
_NEAR, _FAR = 0.17, 0.34
"""Distances of the hand from an eye at which its fiducial can be read [m]."""
_MARGIN = 40.0
"""Planned points stay this far from the images' edges: true lenses differ [px]."""
_FACING = np.cos(np.radians(60.0))
"""Least cosine between a fiducial's normal and the way to an eye."""
_ARC = np.radians(110.0)
"""Largest arc of a sweep."""
_BOARD_NEAR, _BOARD_FAR = 0.24, 0.45
_BOARD_TILT = 0.38
"""Standard deviation of a board's attitude about each axis [rad]."""
_BOARD_ROOM = 0.09
"""How far before the base's frame all of a board is held [m]."""


@dataclass(frozen=True, eq=False)
class VisibleWorkspace:
    """An arm before its eyes as described; all of it is only nearly true of an individual."""

    arm: ArmDescription
    """The arm; joints of the head at their values among the held ones."""
    rig: StereoRig
    """The eyes as designed, in the frame of the arm's base."""
    markers: tuple[str, ...]
    """Points that must be in view."""
    body: CollisionShapes
    """The robot's collision shapes."""

    @classmethod
    def of(
        cls,
        arm: ArmDescription,
        markers: tuple[str, ...] | None = None,
        eyes: StereoRig = NICO_CAMERAS,
    ) -> "VisibleWorkspace":
        """Build it.

        Args:
            arm: The robot and its arm.
            markers: Points of the arm that must be in view; all of them by default.
            eyes: The eyes as designed; each is mounted on a link of its own.

        Raises:
            ModelError: If the robot has no such links, or no such point.
        """
        markers = arm.markers if markers is None else markers
        if set(markers) - set(arm.markers):
            raise ModelError(f"the arm has the points {', '.join(arm.markers)}, got {markers}")
        body = CollisionShapes(arm)
        X_BE = [body.pose(link) for link in MOUNTS]
        rig = StereoRig(*(eye.at(X) for eye, X in zip(eyes.eyes, X_BE, strict=True)))
        return cls(arm, rig, markers, body)

    def first_guess(self, joints: Sequence[JointInfo]) -> SelfModel:
        """Return what a body may believe of itself before it has learned anything.

        The arm and the eyes are as described; gears and zeros follow from the joints' stops, which
        lie only near the description's limits.

        Args:
            joints: The body's joints, with stops.

        Returns:
            A self-model in the frame of the arm's base.

        Raises:
            ValueError: If a joint has no stops.
        """
        if any(joint.lower is None or joint.upper is None for joint in joints):
            raise ValueError("gears and zeros cannot be guessed of joints without stops")
        unit = np.array([joint.sign * joint.radians_per_unit for joint in joints])
        ends = np.array([[joint.lower, joint.upper] for joint in joints], dtype=float)
        low, high = np.sort(unit[:, None] * ends, axis=1).T
        gear = (high - low) / (self.arm.upper - self.arm.lower)
        servos = ServoMap(
            self.arm.joints,
            offset=low - gear * self.arm.lower,
            gear=gear,
            unit=tuple(joint.encoder_unit for joint in joints),
            counts_per_turn=np.array([joint.counts_per_turn or np.nan for joint in joints]),
            sign=np.array([float(joint.sign) for joint in joints]),
        )
        cameras = {"left": self.rig.left, "right": self.rig.right}
        return SelfModel(
            "first guess",
            DhTable.from_chain(self.arm.chain),
            servos,
            robot=self.arm.source,
            cameras=cameras,
        )

    def in_view(self, q: NDArray) -> NDArray:
        """Return at which poses both eyes should see all points well. Shapes (N, n) -> (N,).

        Points on a fiducial, whose frames point their z out of it, must face the eyes.

        Args:
            q: Joint angles of the description [rad].
        """
        seen = np.ones(len(q), dtype=bool)
        for marker in self.markers:
            k = self.arm.markers.index(marker)
            p_BH = self.arm.chain.forward(q, k)
            seen &= self._inside(p_BH)
            if "fiducial" in self.arm.points[marker]:
                seen &= self._faces(q, k, p_BH)
        return seen

    def usable(self, q: NDArray) -> NDArray:
        """Return which poses are in view and free of collisions. Shapes (N, n) -> (N,)."""
        ok = self.in_view(q)
        ok[ok] = [not self.body.collides(pose) for pose in q[ok]]
        return ok

    def random_poses(self, count: int, rng: np.random.Generator) -> NDArray:
        """Draw usable poses within the joints' limits [rad]. Shape (count, n).

        Raises:
            ModelError: If hardly any pose is usable.
        """
        found: list[NDArray] = []
        for _ in range(200):
            q = rng.uniform(self.arm.lower, self.arm.upper, (1000, len(self.arm.lower)))
            found += list(q[self.usable(q)])
            if len(found) >= count:
                return np.array(found[:count])
        raise ModelError(
            f"only {len(found)} of 200000 poses show {', '.join(self.markers)} to both eyes: turn "
            "the head or hold other joints"
        )

    def home_and_arcs(self, candidates: int = 80) -> tuple[NDArray, NDArray]:
        """Return the home whose smallest sweep in view is largest, and the sweeps.

        Args:
            candidates: Usable poses looked at.

        Returns:
            Home [rad], shape (n,), and lower and upper end of each joint's sweep [rad], (n, 2).
        """
        poses = self.random_poses(candidates, np.random.default_rng(0))
        return widest_sweeps(self.arm, poses, self.usable, _ARC, self.markers)

    def board_poses(self, board: Board, count: int, rng: np.random.Generator) -> NDArray:
        """Draw poses in which a board should be seen whole by both eyes, before the body.

        Args:
            board: The board.
            count: How many.
            rng: Source.

        Returns:
            X_BG, as `NicoStation.hold_board` takes them. Shape (count, 4, 4).

        Raises:
            ModelError: If such a board never fits into both images.
        """
        center = board.points.mean(axis=0)
        found: list[NDArray] = []
        for _ in range(4000 * count):
            depth = rng.uniform(_BOARD_NEAR, _BOARD_FAR)
            aside = rng.uniform(-0.5, 0.5, 2) * depth + [0.035, 0.0]
            attitude = rotation_from_vector(rng.normal(0.0, _BOARD_TILT, 3))
            X_BG = self.rig.left.X_WC @ transform(attitude, [aside[0], aside[1], depth])
            X_BG = X_BG @ transform(np.eye(3), -center)
            corners = apply(X_BG, board.points)
            if self._inside(corners, 0.0, np.inf).all() and corners[:, 0].min() > _BOARD_ROOM:
                found.append(X_BG)
                if len(found) == count:
                    return np.array(found)
        raise ModelError(
            f"a {board} board with squares of {1e3 * board.square:.0f} mm does not fit"
        )

    def _inside(self, p_BQ: NDArray, near: float = _NEAR, far: float = _FAR) -> NDArray:
        """Return which points both eyes see away from the edges and at a distance between two."""
        pixels = self.rig.project(p_BQ)
        limit = np.array([*self.rig.left.image_size] * 2) - 1.0 - _MARGIN
        with np.errstate(invalid="ignore"):
            inside = ((pixels > _MARGIN) & (pixels < limit)).all(axis=1)
        for eye in self.rig.eyes:
            distance = np.linalg.norm(p_BQ - eye.X_WC[:3, 3], axis=1)
            inside &= (distance > near) & (distance < far)
        return np.asarray(inside)

    def _faces(self, q: NDArray, k: int, p_BH: NDArray) -> NDArray:
        """Return whether the z axis of a point's frame points to both eyes."""
        tip = Chain(
            self.arm.chain.joints,
            self.arm.chain.directions,
            self.arm.chain.points,
            ("tip",),
            apply(self.arm.links.X_BH[k], np.array([[0.0, 0.0, 1.0]])),
        )
        normal = tip.forward(q) - p_BH
        faces = np.ones(len(q), dtype=bool)
        for eye in self.rig.eyes:
            way = eye.X_WC[:3, 3] - p_BH
            cosine = np.sum(way * normal, axis=1) / np.linalg.norm(way, axis=1)
            faces &= cosine > _FACING
        return faces
