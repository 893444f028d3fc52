"""Where a robot sees its hand by its description: poses in view, home, sweeps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.planning.first_guess import first_guess
from nico_selfmodel.planning.plans import Plan, commands_of_angles, pose_plan
from nico_selfmodel.planning.sweeps_in_view import widest_sweeps
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.collisions import CollisionShapes
from nico_selfmodel.systems.nico_cameras import MOUNTS, NICO_CAMERAS

SPARE = 1.25
"""Poses planned for each that is wanted: some hide the marker after all."""
HOME_REPEATS = 4


@dataclass(frozen=True)
class ViewLimits:
    """When a point on the hand counts as well in view, and how poses are looked for."""

    near: float
    """Least distance of the hand from a camera [m]."""
    far: float
    """Largest distance of the hand from a camera [m]."""
    margin: float
    """Planned points stay this far from the images' edges: true lenses differ [px]."""
    arc: float
    """Largest arc of a sweep [rad]."""
    homes: int
    """Poses of which the one with the widest sweeps becomes home."""
    batch: int
    """Random poses drawn at a time."""
    cameras: int = 2
    """Cameras that distances count from: the left one or both."""
    touching: bool = False
    """Whether the arm may touch the body or itself, and a fiducial be turned away."""


RENDERED = ViewLimits(0.17, 0.34, 40.0, np.radians(110.0), 80, 1000)
"""What finding a fiducial in pictures takes."""
PROJECTED = ViewLimits(0.17, 0.38, 45.0, np.radians(90.0), 150, 2000, 1, touching=True)
"""Where nothing is rendered: a point that is in the image is found."""
FACING = np.cos(np.radians(60.0))
"""Least cosine between a fiducial's normal and the way to a camera."""


@dataclass(frozen=True, eq=False)
class VisibleWorkspace:
    """An arm before its cameras as described; all of it is only nearly true of an instance."""

    arm: ArmDescription
    """The arm; joints of the head at their values among the held ones."""
    rig: StereoRig
    """The cameras as designed, in the frame of the arm's base."""
    markers: tuple[str, ...]
    """Points that must be in view."""
    body: CollisionShapes
    """The robot's collision shapes."""
    limits: ViewLimits = RENDERED
    """What counts as in view."""

    @classmethod
    def of(
        cls,
        arm: ArmDescription,
        markers: tuple[str, ...] | None = None,
        cameras: StereoRig = NICO_CAMERAS,
        limits: ViewLimits = RENDERED,
    ) -> "VisibleWorkspace":
        """Build it.

        Args:
            markers: Points of the arm that must be in view; all of them by default.
            cameras: As designed; each is mounted on a link of its own.

        Raises:
            ModelError: If the robot has no such links, or no such point.
        """
        markers = arm.markers if markers is None else markers
        if set(markers) - set(arm.markers):
            raise ModelError(f"the arm has the points {', '.join(arm.markers)}, got {markers}")
        body = CollisionShapes(arm)
        X_BC = [body.pose(link) for link in MOUNTS]
        rig = StereoRig(*(c.at(X) for c, X in zip(cameras.cameras, X_BC, strict=True)))
        return cls(arm, rig, markers, body, limits)

    @property
    def up_C(self) -> NDArray:
        """The vertical in the left camera's frame, of a robot whose root stands upright. (3,)."""
        up_B = self.body.pose(self.arm.links.root_link)[:3, 2]
        return self.rig.left.X_WC[:3, :3].T @ up_B

    def holding(self, shift: ArrayLike) -> "VisibleWorkspace":
        """Return the workspace of the arm with a tool in its hand.

        Args:
            shift: From the hand's markers to the tool's tip, along the base's axes at q = 0 [m].
        """
        chain = self.arm.chain
        held = replace(chain, p_WH_zero=chain.p_WH_zero + np.asarray(shift, dtype=float))
        return replace(self, arm=replace(self.arm, chain=held))

    def first_guess(self, joints: Sequence[JointInfo]) -> SelfModel:
        """Return what a robot may assume of itself before it has learned anything.

        Args:
            joints: Its joints, with stops.

        Returns:
            A self-model in the frame of the arm's base.

        Raises:
            ValueError: If a joint has no stops.
        """
        return first_guess(self.arm, self.rig, joints)

    def in_view(self, q: NDArray) -> NDArray:
        """Return at which poses both cameras should see all points well. Shapes (N, n) -> (N,).

        Points on a fiducial, whose frames point their z out of it, must face the cameras.

        Args:
            q: Joint angles of the description [rad].
        """
        seen = np.ones(len(q), dtype=bool)
        limits = self.limits
        for marker in self.markers:
            k = self.arm.markers.index(marker)
            p_BH = self.arm.chain.forward(q, k)
            seen &= self.shows(p_BH, limits.near, limits.far)
            if "fiducial" in self.arm.points[marker] and not limits.touching:
                seen &= self._faces(q, k, p_BH)
        return seen

    def usable(self, q: NDArray) -> NDArray:
        """Return which poses are in view and free of collisions. Shapes (N, n) -> (N,)."""
        ok = self.in_view(q)
        if not self.limits.touching:
            ok[ok] = [not self.body.collides(pose) for pose in q[ok]]
        return ok

    def random_poses(self, count: int, rng: np.random.Generator) -> NDArray:
        """Draw usable poses within the joints' limits [rad]. Shape (count, n).

        Raises:
            ModelError: If hardly any pose is usable.
        """
        found: list[NDArray] = []
        batch, n = self.limits.batch, len(self.arm.lower)
        for _ in range(200 if count else 0):
            q = rng.uniform(self.arm.lower, self.arm.upper, (batch, n))
            found += list(q[self.usable(q)])
            if len(found) >= count:
                break
        if len(found) < count:
            raise ModelError(
                f"only {len(found)} of {200 * batch} poses show {', '.join(self.markers)} to both "
                "cameras: turn the head or hold other joints"
            )
        return np.reshape(found[:count], (count, n))

    def home_and_arcs(self, candidates: int | None = None) -> tuple[NDArray, NDArray]:
        """Return the home whose smallest sweep in view is largest, and the sweeps.

        Args:
            candidates: Usable poses looked at.

        Returns:
            Home [rad], shape (n,), and lower and upper end of each joint's sweep [rad], (n, 2).
        """
        poses = self.random_poses(candidates or self.limits.homes, np.random.default_rng(0))
        return widest_sweeps(self.arm, poses, self.usable, self.limits.arc, self.markers)

    def plan(
        self,
        joints: Sequence[JointInfo],
        circle: int,
        free: int,
        rng: np.random.Generator,
        spare: float = SPARE,
    ) -> Plan:
        """Plan circles and free poses in view of both cameras, some free ones to spare.

        Args:
            joints: The joints with stops, which stand for the limits of the description.
            circle: Poses on circles, home not counted.
            free: Free poses wanted.
            spare: Poses planned for each that is wanted.
        """
        arm, n = self.arm, len(self.arm.joints)

        def to(q: NDArray) -> NDArray:
            return commands_of_angles(joints, arm.lower, arm.upper, q)

        poses = self.random_poses(int(np.ceil(spare * free)), rng)
        home, ends = self.home_and_arcs() if circle else (arm.lower, np.zeros((n, 2)))
        return pose_plan(
            joints, to(home), to(ends.T).T, circle, to(poses), home_repeats=HOME_REPEATS
        )

    def shows(self, p_BQ: NDArray, near: float = 0.0, far: float = np.inf) -> NDArray:
        """Return which points both cameras see away from their images' edges. (N, 3) -> (N,).

        Args:
            p_BQ: Points in the arm's base [m].
            near: Least distance [m].
            far: Largest distance [m].
        """
        inside = self.rig.inside(self.rig.project(p_BQ), self.limits.margin)
        for camera in self.rig.cameras[: self.limits.cameras]:
            distance = np.linalg.norm(p_BQ - camera.X_WC[:3, 3], axis=1)
            inside &= (distance > near) & (distance < far)
        return inside

    def normals(self, q: NDArray, k: int) -> NDArray:
        """Return the z axis of a point's frame, which points out of a fiducial. Shape (N, 3).

        Args:
            q: Joint angles of the description [rad]. Shape (N, n).
            k: Index of the point.
        """
        chain = self.arm.chain
        tip = apply(self.arm.links.X_BH[k], np.array([[0.0, 0.0, 1.0]]))
        ends = Chain(chain.joints, chain.directions, chain.points, ("z",), tip).forward(q)
        return ends - chain.forward(q, k)

    def _faces(self, q: NDArray, k: int, p_BH: NDArray) -> NDArray:
        """Return whether the z axis of a point's frame points to both cameras."""
        normal, faces = self.normals(q, k), np.ones(len(q), dtype=bool)
        for camera in self.rig.cameras:
            way = camera.X_WC[:3, 3] - p_BH
            cosine = np.sum(way * normal, axis=1) / np.linalg.norm(way, axis=1)
            faces &= cosine > FACING
        return faces
