"""Where to turn a head so that a point comes to the middle of its cameras' images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, Frame

from nico_selfmodel.errors import ModelError, check_kind
from nico_selfmodel.geometry.rotation import frame_along
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.minimum import minimum_near
from nico_selfmodel.plant.body_plant import BodyPlant
from nico_selfmodel.plant.kinematic_tree import rigid
from nico_selfmodel.plant.looking.again import SeenOff, seen_place

WITHIN_PX = 10.0
"""Distance from the middle of each image within which a point counts as looked at [px]."""
_NEAREST = 0.02
"""Distance before a camera below which nothing is looked at [m]."""
_POSTURE_PX = 5.0
"""What it is worth not to turn a joint by 1 rad from the middle of its range [px]."""
_LOADED_ROUNDS = 3
"""How often the posture of a body that bends is taken into account."""


@dataclass(frozen=True, eq=False)
class Gaze:
    """How a body looks at a point."""

    readings: NDArray
    """Of all joints in their own units, nan where one has no encoder; only those that turn cameras
    differ from what was given. Shape (n,)."""
    pixels: dict[str, NDArray]
    """Where each camera then expects the point [px]. Shape (2,) each."""
    off_px: float
    """Largest distance of these from the middle of their images [px]."""
    misaligned_px: float = 0.0
    """What of it is not the cameras' mean, which is as far off as it can be: they look past each
    other, by how they stand on one tilt, or as they do not converge that far [px]."""

    @property
    def missed_px(self) -> float:
        """How far the cameras' mean is from the middle of their images [px]."""
        return self.off_px - self.misaligned_px


@dataclass(frozen=True, eq=False)
class _Posture:
    """Where a head stays near."""

    easy: NDArray
    """Readings of all joints, in their own units. Shape (n,)."""
    weight: NDArray
    """What it is worth not to turn each joint of the head by 1 rad from there [px]. Shape (m,)."""


class GazeSolver:
    """Turns the joints of a learned body's cameras, by Drake's inverse kinematics.

    Of both cameras it minimises `sum (f / z)^2 |(x, y)|^2 + c^2 |q - q_easy|^2`, with (x, y, z)
    the point in a frame at the camera whose z axis is the line of sight of the image's middle and c
    `_POSTURE_PX` a radian: pixels off the middle, and little weight on an easy posture, which
    decides between neck and cameras: the middle of each range, where none is given. Joints keep
    their limits, and z > 0.
    """

    def __init__(self, model: BodyModel, cameras: Sequence[str] = ()) -> None:
        """Take a learned body.

        Args:
            cameras: Those that shall look; all that joints carry if empty.

        Raises:
            TypeError: If it is no body.
            ModelError: If it has no such camera, or no joint turns one, or a joint is a flange.
        """
        check_kind(model, BodyModel, "give a learned body, with joints that turn cameras")
        tree = model.tree
        self.model, self.cameras = model, _looking(tree, cameras)
        moving = np.any([tree.beyond[tree.sensors[i].on] for i in self.cameras], axis=0)
        led = np.asarray(tree.coupling).diagonal() == 0.0
        self.head = np.flatnonzero((np.abs(tree.coupling).T @ moving > 0.0) & ~led)
        self._plant = MultibodyPlant(0.0)
        self._body = BodyPlant.add_to(self._plant, model)
        self._aims = [self._aim(i) for i in self.cameras]
        self._plant.Finalize()
        self._context = self._plant.CreateDefaultContext()
        self._columns = self._body.columns_of(tree.joints)
        self._reach = model.reach

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that are turned."""
        return tuple(self.model.tree.joints[i] for i in self.head.tolist())

    @property
    def read(self) -> NDArray:
        """Which joints have encoders, and do not follow others. Boolean, shape (n,)."""
        return np.asarray(self.model.tree.coupling).diagonal() != 0.0

    def at_point(
        self,
        readings: ArrayLike,
        p_WT: ArrayLike,
        easy: ArrayLike | None = None,
        stiff: ArrayLike = 1.0,
    ) -> Gaze:
        """Look at a point.

        Args:
            readings: Of all joints in their own units; nan where one has no encoder. Shape (n,).
            p_WT: The point in the body's world [m]. Shape (3,).
            easy: Readings which the head stays near where it can choose, like `readings`; the
                middle of its range if omitted. Shape (n,).
            stiff: How much more than another each of `joints` stays there. Shape (m,).

        Raises:
            ModelError: If it is out of reach.
            ValueError: If a shape is another, or a number not finite.
        """
        now = self._checked(readings)
        point = np.asarray(p_WT, dtype=float)
        if point.shape != (3,) or not np.isfinite(point).all():
            raise ValueError(f"a point to look at must be 3 finite coordinates [m], got {p_WT}")
        posture = _Posture(
            self._easy(now) if easy is None else self._checked(easy),
            _POSTURE_PX * np.broadcast_to(np.asarray(stiff, dtype=float), self.head.shape),
        )
        best = self._best(now, point, posture)
        if not best.missed_px <= WITHIN_PX:
            where = ", ".join(f"{value:.3f}" for value in point)
            off = (
                f"{best.off_px - best.misaligned_px:.0f} px"
                if np.isfinite(best.off_px)
                else "out of view or behind"
            )
            raise ModelError(
                f"out of reach: the point {where} m stays {off} in place of the images' middle, "
                f"at most {WITHIN_PX:.0f} px are expected, wherever {listed(self.joints)} turn: "
                "give a point before the head"
            )
        return best

    def place_of(self, readings: ArrayLike, marker: str) -> NDArray:
        """Return where a marker of the body is expected, if the head does not carry it.

        Args:
            readings: Of all joints in their own units; nan where one has no encoder. Shape (n,).

        Returns:
            In the body's world [m]. Shape (3,).

        Raises:
            ModelError: If it is on a link that the joints of the head turn.
            ValueError: If there is no such marker, or a number is not finite.
        """
        tree, now = self.model.tree, self._checked(readings)
        found = tree.markers[tree.marker_index(marker)]
        if found.on != WORLD and (moved := tree.beyond[found.on][self.head]).any():
            turning = [self.joints[k] for k in np.flatnonzero(moved).tolist()]
            raise ModelError(
                f"marker {marker!r} moves with {listed(turning)}, which would look at it: choose "
                "one that the head does not carry"
            )
        motion = TreeMotion.at(tree, self.model.readings(now)[None])
        return motion.pose_of(found)[1][:, 0]

    def again(
        self,
        readings: ArrayLike,
        p_WT: ArrayLike,
        pixels: Mapping[str, ArrayLike],
        before: SeenOff | None = None,
    ) -> SeenOff:
        """Count a look at a point: how far it is from where it was expected.

        Add the `offset` to the point, and look there.

        Args:
            readings: At which it was seen, of all joints in their own units. Shape (n,).
            p_WT: Where the point was expected [m]. Shape (3,).
            pixels: Camera -> where it saw the point, nan if not [px]. Shape (2,) each.
            before: What earlier looks told.

        Returns:
            The mean with this look; as before where no camera saw the point.

        Raises:
            ModelError: If there is no such camera.
            ValueError: If a pixel is not in its image, or a shape is another.
        """
        unknown = sorted(set(pixels) - set(cameras := self._cameras(self._checked(readings))))
        if unknown:
            raise ModelError(f"no camera {listed(unknown)} looks; there are {listed(cameras)}")
        for name, uv in pixels.items():
            _check_in_image(name, np.asarray(uv, dtype=float), cameras[name].image_size)
        before = before or SeenOff()
        place = seen_place(cameras, pixels, p_WT)
        return before if place is None else before.after(place - np.asarray(p_WT, dtype=float))

    def off_middle(self, pixels: Mapping[str, ArrayLike]) -> tuple[float, float]:
        """Return how far a point is from the middle of images, and what of it is misalignment [px].

        With offsets o_i of the cameras it is `max |o_i|`, and that less `|mean o_i|`.

        Args:
            pixels: Camera -> where it sees the point [px]. Shape (2,) each.

        Returns:
            Both as `Gaze` has them; nan if a camera sees nothing.
        """
        lenses = self.model.tree.lenses
        off = [np.asarray(uv) - _middle(lenses[name].image_size) for name, uv in pixels.items()]
        largest = float(np.max(np.linalg.norm(off, axis=1)))
        return largest, largest - float(np.linalg.norm(np.mean(off, axis=0)))

    def _cameras(self, readings: NDArray) -> dict[str, Camera]:
        """Return the cameras that look, in the body's world."""
        tree = self.model.tree
        motion = TreeMotion.at(tree, self.model.readings(readings)[None])
        looking = [tree.sensors[i] for i in self.cameras]
        return {s.name: tree.lenses[s.name].at(motion.poses(s)[0]) for s in looking}

    def _checked(self, readings: ArrayLike) -> NDArray:
        now = np.asarray(readings, dtype=float)
        tree = self.model.tree
        if now.shape != (len(tree.joints),):
            raise ValueError(f"readings must have shape ({len(tree.joints)},), got {now.shape}")
        if not np.isfinite(now[self.read]).all():
            raise ValueError(f"readings must be finite, got {now[self.read]}")
        return now

    def _aim(self, sensor: int) -> Frame:
        """Add a frame at a camera whose z axis is the line of sight of the image's middle."""
        item = self.model.tree.sensors[sensor]
        lens = self.model.tree.lenses[item.name]
        z = lens.at(np.eye(4)).directions(_middle(lens.image_size)[None])[0]
        X_CA = transform(frame_along(z), np.zeros(3))
        frame = FixedOffsetFrame(f"{item.name}_aim", self._body.frame(item.name), rigid(X_CA))
        return self._plant.AddFrame(frame)

    def _easy(self, now: NDArray) -> NDArray:
        """Return readings with the head in the middle of its range."""
        model, out = self.model, now.copy()
        limited = np.isfinite(self._reach).all(axis=0)
        q = np.where(limited, np.where(limited, self._reach, 0.0).mean(axis=0), 0.0)
        out[self.head] = (q * model.tree.gear / model.si_per_unit)[self.head]
        return out

    def _best(self, now: NDArray, point: NDArray, posture: "_Posture") -> Gaze:
        """Solve from where the head is and from where it is easy, where that is elsewhere."""
        same = np.array_equal(now, posture.easy, equal_nan=True)
        starts = [now] if same else [now, posture.easy]
        found = [self._looked(start, point, posture) for start in starts]
        return min(found, key=lambda gaze: gaze.missed_px)

    def _looked(self, readings: NDArray, point: NDArray, posture: "_Posture") -> Gaze:
        """Solve from a posture; what bends is taken from the posture before."""
        model, tree, limits = self.model, self.model.tree, self.model.limits
        rounds = 1 if tree.bending is None else _LOADED_ROUNDS
        now = readings.copy()
        for _ in range(rounds):
            si = model.readings(now)
            self._body.set_readings(self._context, si)
            loaded = self._plant.GetPositions(self._context)[self._columns]
            bent = loaded - tree.displacements(si)
            q = self._solved(loaded, bent, point, posture)
            turned = ((q - bent) * tree.gear / model.si_per_unit)[self.head]
            now[self.head] = np.clip(turned, *limits[:, self.head])
        return self._seen(now, point)

    def _solved(self, q: NDArray, bent: NDArray, point: NDArray, posture: "_Posture") -> NDArray:
        """Return angles of all joints, those of the head turned [rad]. Shape (n,)."""
        plant, tree = self._plant, self.model.tree
        problem = InverseKinematics(plant, self._context, with_joint_limits=False)
        program, x = problem.prog(), problem.q()[self._columns]
        turned = np.zeros(len(q), dtype=bool)
        turned[self.head] = True
        led = np.asarray(tree.coupling).diagonal() == 0.0
        fixed = ~turned & ~led
        program.AddBoundingBoxConstraint(q[fixed], q[fixed], x[fixed])
        low, high = self._reach + bent
        program.AddBoundingBoxConstraint(low[turned], high[turned], x[turned])
        for i in np.flatnonzero(led).tolist():
            # What follows is where its leaders have it, q_i = sum_j c_ij q_j.
            row = np.eye(len(q))[i] - tree.coupling[i]
            program.AddLinearEqualityConstraint(row[None], [bent[i] - tree.coupling[i] @ bent], x)
        q_easy = np.nan_to_num(posture.easy * self.model.si_per_unit / tree.gear)[self.head]
        program.AddQuadraticErrorCost(np.diag(posture.weight**2), q_easy, x[self.head])
        self._add_looking(problem, point)
        start = plant.GetPositions(self._context)
        return minimum_near(program, start, x)

    def _add_looking(self, problem: InverseKinematics, point: NDArray) -> None:
        """Add what each camera's image wants, and that the point is before it."""
        world = self._plant.world_frame()
        for sensor, aim in zip(self.cameras, self._aims, strict=True):
            lens = self.model.tree.lenses[self.model.tree.sensors[sensor].name]
            X_WA = aim.CalcPoseInWorld(self._context)
            z = max(float(np.linalg.norm(X_WA.translation() - point)), _NEAREST)
            C = np.diag([(lens.fx / z) ** 2, (lens.fy / z) ** 2, 0.0])
            problem.AddPositionCost(aim, np.zeros(3), world, point, C)
            nearest, farthest = [-np.inf, -np.inf, _NEAREST], [np.inf] * 3
            problem.AddPositionConstraint(world, point, aim, nearest, farthest)

    def _seen(self, readings: NDArray, point: NDArray) -> Gaze:
        """Predict where the cameras see the point."""
        cameras = self._cameras(readings)
        pixels = {name: camera.project(point) for name, camera in cameras.items()}
        off, misaligned = self.off_middle(pixels)
        if not all(_in_image(uv, cameras[name].image_size) for name, uv in pixels.items()):
            off, misaligned = np.inf, 0.0
        return Gaze(readings, pixels, off, misaligned)


def _check_in_image(name: str, uv: NDArray, size: tuple[int, int]) -> None:
    """Refuse a pixel that is not in its camera's image; nan is where nothing was seen."""
    if uv.shape != (2,):
        raise ValueError(f"{name} sees at u, v: expected shape (2,), got {uv.shape}")
    if np.isfinite(uv).all() and not _in_image(uv, size):
        u, v = uv
        raise ValueError(
            f"{name} cannot see at {u:g}, {v:g} px: its image is {size[0]} x {size[1]} px"
        )


def _in_image(uv: NDArray, size: tuple[int, int]) -> bool:
    return bool(((uv >= -0.5) & (uv <= np.array(size) - 0.5)).all())


def _middle(image_size: tuple[int, int]) -> NDArray:
    """Return the pixel in the middle of an image. Shape (2,)."""
    return (np.array(image_size) - 1.0) / 2.0


def _looking(tree: BodyTree, cameras: Sequence[str]) -> list[int]:
    """Return the sensors that are cameras on links that joints move, or some of them by name."""
    if FLANGE in tree.motions:
        raise ModelError("a body whose flange's pose is read has no joints that turn a head")
    carried = {s.name: i for i, s in enumerate(tree.sensors) if s.name in tree.lenses}
    carried = {name: i for name, i in carried.items() if tree.sensors[i].on != WORLD}
    if not carried:
        raise ModelError(
            "no joint of this body turns a camera, so that it cannot look at anything: learn one "
            "whose cameras are on links of its head"
        )
    unknown = sorted(set(cameras) - set(carried))
    if unknown:
        raise ModelError(f"no joint turns a camera {listed(unknown)}; there are {listed(carried)}")
    return [carried[name] for name in cameras or carried]
