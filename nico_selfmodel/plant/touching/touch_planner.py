"""How an arm brings its finger to a place of its own body, or why it cannot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.multibody.inverse_kinematics import InverseKinematics

from nico_selfmodel.arrays import frozen_array, read_only
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.minimum import minimum_near
from nico_selfmodel.plant.description import ArmDescription
from nico_selfmodel.plant.touching.posed_arm import PosedArm

APPROACH = 0.030
"""Distance from the place at which the finger begins to come along the normal [m]."""
LEAN = np.radians(60.0)
"""Largest angle between the finger and the way into the surface [rad]."""
WIDE = 0.008
"""Distance of the arm from the body that is looked for first, the finger excepted [m]."""
CLEAR = 0.005
"""Least distance of the arm from the body in a posture, the finger excepted [m]."""
NARROW = 0.0035
"""The same where there is no way at that distance [m]. Of 249 ways of robots 1853, 1893 and 1894
the true arm, whose joints are loose, came more than this nearer than planned on four."""
_BETWEEN = 5
"""Steps from one posture of a way to the next at which the body as it is drawn is looked at."""
_AWAY = (APPROACH, 0.02, 0.01, 0.0)
"""Distances from the place on the way to it [m]."""
_NEAR, _SLACK = 1e-4, 1e-3
"""Within which a posture is where it should be [m, rad], and within which bounds are kept."""
_NEAREST = 1e-3
"""Nearer than this the nearest is there, but for what a solver leaves [m]."""
_JUMP = 0.5
"""A joint that turns farther than this from one of these places to the next is on no way [rad]."""
_STARTS, _SURE = 32, 8
"""Postures to start from, and how many of them must end far away to be sure of it."""
_DRAWN = 1000
"""Postures drawn at random, of which those are started from that come nearest."""
_TURN = 0.1
"""What a radian that the finger leans too far counts as, where these are chosen [m]."""
_FAR = 0.02
"""What ends farther away than this is far away [m]."""
_STEPS = 100
"""Of a solver: one that finds no posture would take 1000, and none that does was lost with 30."""
_LOADED_ROUNDS = 4
"""How often the posture of an arm that bends is taken into account."""


@dataclass(frozen=True, eq=False)
class Touch:
    """A way of the finger to a place: first away from it along the normal, at last there."""

    q: NDArray
    """Angles of the arm's joints [rad]. Shape (k, n)."""
    readings: NDArray
    """Of the encoders there [encoder units]. Shape (k, n)."""
    p_WT: NDArray
    """Where the ball at the finger's end is nearest to the place's tangent plane, as the model
    predicts it from the readings [m]. Shape (k, 3)."""
    clearance: float
    """Least distance of the arm from the body on that way, the finger excepted [m]."""
    lean: float
    """Angle between finger and the way into the surface, at the place [rad]."""


@dataclass(frozen=True)
class OutOfReach:
    """That a place cannot be touched."""

    reason: str
    """Why: what comes nearest to a way."""


@dataclass(frozen=True, eq=False)
class _Place:
    """A place and its outward normal, in the model's world. Shapes (3,)."""

    p_WM: NDArray
    n_W: NDArray


@dataclass(frozen=True)
class _Lacking:
    """What a start did not lead to."""

    asked: int
    """How far it came: 0 not to the place, 3 all but a way to it."""
    off: float
    """How far from the place it stayed, where it did [m]."""
    what: str
    """In words."""

    @property
    def rank(self) -> tuple[int, float]:
        """Larger where it came farther."""
        return self.asked, -self.off


_WORDS = (
    "the finger stays {off:.0f} mm away",
    f"the finger does not come there leaning by at most {np.degrees(LEAN):.0f} deg",
    "the arm does not come there {clear:g} mm away from the rest of the body",
)
"""What is lacking where not all that was asked for could be had."""


class TouchPlanner:
    """Plans ways of a learned arm's finger to places of the body, by Drake's inverse kinematics.

    With the finger's end a ball of radius r about E, pointing along f, a place p and its normal n,
    each posture of the way has, for a = 30, 20, 10 and 0 mm,

        p_E(q) = p + (r + a) n,    angle(f(q), -n) <= 60 deg,    lower <= q <= upper,
        distance(arm but for the finger, body) >= 8 mm, 5 mm, or what else is asked for,

    and of these, for the last, the q nearest to the middle of the joints' ranges, and then those
    nearest to the posture before. So it touches at p whatever it leans. Several starts are tried,
    the middle and, of postures drawn at random, those that bring the finger nearest to place and
    direction; the first whole way counts that is as far from the body as it is drawn, between these
    postures, too. How the arm comes to where the way begins is not planned.
    """

    def __init__(
        self,
        arm: ArmDescription,
        model: SelfModel,
        finger: str,
        *,
        held: Mapping[str, float] | None = None,
        X_WB: ArrayLike | None = None,
        limits: ArrayLike | None = None,
        shape: BodyShape | None = None,
        clear: Sequence[float] = (WIDE, CLEAR),
    ) -> None:
        """Take an arm as it is known; nothing moves.

        Args:
            finger: Link of the finger, whose collision shape is one capsule.
            held: Joint -> angle where one that nobody commands stands elsewhere [rad].
            X_WB: Where the body stands, of where the learned arm has it; places and what
                was seen of it move by it, the description's shapes stay. Shape (4, 4).
            limits: Of the readings, lower and upper [encoder units], which count in place of the
                description's: these are angles, and where a learned joint has its zero is free
                where the shape of the links makes up for it. Shape (2, n).
            shape: What the robot has learned of the surfaces of its links: the arm keeps off what
                was seen of them beside what the description has.
            clear: Distances of the arm from the body that are looked for, the largest first [m].

        Raises:
            ModelError: If the model has other joints, the link is no finger of that arm, the shape
                is of other links, or the joints have no limits.
            ValueError: If an array has another shape.
        """
        self._X_WB = frozen_array(np.eye(4) if X_WB is None else X_WB, (4, 4), "X_WB")
        self._posed = PosedArm(arm, model, finger, held, shape, self._X_WB)
        self._as_drawn = self._posed.as_drawn()
        reach = np.stack([arm.lower, arm.upper])
        if limits is not None:
            stops = frozen_array(limits, reach.shape, "limits")
            reach = np.sort(model.servos.to_joint(stops), axis=0)
        if not np.isfinite(reach).all():
            raise ModelError(
                "touching takes an arm whose joints have limits: give them in its URDF"
            )
        self._reach = read_only(reach)
        self._clear = tuple(clear)
        self.model = model

    @property
    def posed(self) -> PosedArm:
        """The arm beside its body, as it was posed last."""
        return self._posed

    @property
    def reach(self) -> NDArray:
        """Least and largest angles of the arm's joints [rad]. Shape (2, n)."""
        return self._reach

    def at_place(
        self,
        link: str,
        p_FM: ArrayLike,
        n_F: ArrayLike,
        rng: np.random.Generator,
        *,
        near: ArrayLike | None = None,
    ) -> Touch | OutOfReach:
        """Plan a way to a place of a link.

        Args:
            link: It; the arm does not move it.
            p_FM: The place in the link's frame [m]. Shape (3,).
            n_F: Outward normal of the link there. Shape (3,).
            near: Readings at which to start first, if some are known [encoder units]. Shape (n,).

        Raises:
            ModelError: If there is no such link, or the arm carries it.
            ValueError: If place or normal are not 3 finite numbers, or the normal has no length.
        """
        if link in self._posed.moving:
            raise ModelError(
                f"{link!r} moves with the arm, which cannot touch it: give another link than "
                f"{listed(sorted(self._posed.moving))}"
            )
        X_WF = self._X_WB @ self._posed.link_pose(link)
        p = frozen_array(p_FM, (3,), "p_FM")
        n = X_WF[:3, :3] @ frozen_array(n_F, (3,), "n_F")
        if not np.linalg.norm(n) > 0.0:
            raise ValueError("n_F must have a length, got zeros")
        first = []
        if near is not None:
            readings = frozen_array(near, self._reach[:1].shape[1:], "near")
            first = [np.clip(self.model.servos.to_joint(readings[None])[0], *self._reach)]
        return self._way(_Place(apply(X_WF, p[None])[0], n / np.linalg.norm(n)), first, rng)

    def _way(
        self, place: _Place, first: Sequence[NDArray], rng: np.random.Generator
    ) -> Touch | OutOfReach:
        """Try all starts until one leads all the way, and then nearer to the body."""
        middle = self._reach.mean(axis=0)
        starts = [*first, middle, *self._nearest(place, rng)]
        found: Touch | _Lacking | None = None
        for clear in self._clear:
            found = self._tried(place, starts, clear)
            if isinstance(found, Touch):
                return found
            if found.asked < 2:  # how far it stays from the body was not what was lacking
                break
        assert found is not None, "there are distances"
        return OutOfReach(found.what)

    def _tried(self, place: _Place, starts: Sequence[NDArray], clear: float) -> "Touch | _Lacking":
        """Try starts until one leads all the way; else return what the best of them lacked."""
        best: _Lacking | None = None
        for tried, start in enumerate(starts):
            found = self._from(start, place, clear)
            if isinstance(found, Touch):
                return found
            best = found if best is None else max(best, found, key=lambda one: one.rank)
            if tried + 1 >= _SURE and best.asked == 0 and best.off > _FAR:
                break
        assert best is not None, "there are starts"
        return best

    def _nearest(self, place: _Place, rng: np.random.Generator) -> NDArray:
        """Return random postures that bring the finger nearest to where it should be.

        Of few postures drawn at random hardly one leads to a place that only few postures touch.

        Returns:
            Angles [rad], the nearest first. Shape (k, n).
        """
        drawn = rng.uniform(*self._reach, (_DRAWN, self._reach.shape[1]))
        far = np.empty(_DRAWN)
        for k, q in enumerate(drawn):
            self._posed.pose(q)
            lean = _angle(self._posed.finger_end()[1], -place.n_W)
            far[k] = self._off(place, 0.0) + _TURN * max(lean - LEAN, 0.0)
        return drawn[np.argsort(far)[: _STARTS - 1]]

    def _from(self, start: NDArray, place: _Place, clear: float) -> "Touch | _Lacking":
        """Return the way from a start, or how far it came and what was lacking.

        The place itself comes first, with ever more asked for; then away from it.
        """
        q = start
        for asked in range(3):
            to = q if asked else self._reach.mean(axis=0)
            q = self._solved(q, place, 0.0, asked, clear, to)
            if not self._good(q, place, 0.0, asked, clear):
                off = self._off(place, 0.0)
                what = _WORDS[asked].format(off=1e3 * off, clear=1e3 * clear)
                return _Lacking(asked, off, what)
        way = [q]
        for away in _AWAY[-2::-1]:
            q = self._solved(way[-1], place, away, 2, clear, way[-1])
            if not self._good(q, place, away, 2, clear) or np.abs(q - way[-1]).max() > _JUMP:
                return _Lacking(3, 0.0, f"no way leads there from {1e3 * away:.0f} mm before it")
            way.append(q)
        return self._told(np.array(way[::-1]), place, clear)

    def _solved(
        self, q: NDArray, place: _Place, away: float, asked: int, clear: float, to: NDArray
    ) -> NDArray:
        """Return where a program ends, good or not [rad]. Shape (n,).

        Args:
            q: Where it starts. Shape (n,).
            place: Where the finger should go.
            away: Distance along the normal [m].
            asked: 0 the nearest to the place, 1 the place and the finger's direction, 2 distances
                too.
            clear: Least distance of arm and body [m].
            to: The posture to be near to. Shape (n,).
        """
        posed, finger = self._posed, self._posed.finger
        posed.pose(q)
        problem = InverseKinematics(posed.plant, posed.context, with_joint_limits=False)
        program, x = problem.prog(), problem.q()
        now, columns = posed.plant.GetPositions(posed.context), posed.columns
        still = np.setdiff1d(np.arange(len(now)), columns)
        program.AddBoundingBoxConstraint(now[still], now[still], x[still])
        program.AddBoundingBoxConstraint(*self._reach, x[columns])
        world, frame = posed.plant.world_frame(), posed.finger_frame
        target = place.p_WM + (finger.radius + away) * place.n_W
        if asked == 0:
            problem.AddPositionCost(frame, finger.p_FE, world, target, np.eye(3))
        else:
            program.AddQuadraticErrorCost(np.eye(len(columns)), to, x[columns])
            problem.AddPositionConstraint(frame, finger.p_FE, world, target, target)
            problem.AddAngleBetweenVectorsConstraint(
                frame, finger.way, world, -place.n_W, 0.0, LEAN
            )
        if asked >= 2:
            problem.AddMinimumDistanceLowerBoundConstraint(clear, CLEAR)
        return np.clip(minimum_near(program, now, x[columns], _STEPS), *self._reach)

    def _good(self, q: NDArray, place: _Place, away: float, asked: int, clear: float) -> bool:
        """Return whether a posture has all that was asked for; the arm stands so afterwards."""
        posed = self._posed
        posed.pose(q)
        if not self._off(place, away) < (_NEAREST if asked == 0 else _NEAR):
            return False
        if asked >= 1 and _angle(posed.finger_end()[1], -place.n_W) > LEAN + _SLACK:
            return False
        return asked < 2 or posed.clearance()[0] >= clear - _NEAR

    def _off(self, place: _Place, away: float) -> float:
        """Return how far the finger is from where it should be, as the arm is posed [m]."""
        target = place.p_WM + (self._posed.finger.radius + away) * place.n_W
        return float(np.linalg.norm(self._posed.finger_end()[0] - target))

    def _told(self, way: NDArray, place: _Place, least: float) -> "Touch | _Lacking":
        """Return a way with its readings, and what the model predicts of them."""
        posed = self._posed
        readings, ends = [], []
        lean = 0.0
        for q in way:
            readings.append(self._commands(q))
            posed.read(readings[-1])
            p_WE, pointing = posed.finger_end()
            ends.append(p_WE - posed.finger.radius * place.n_W)
            lean = _angle(pointing, -place.n_W)
        if (off := np.linalg.norm(ends[-1] - place.p_WM)) > 10.0 * _NEAR:
            return _Lacking(3, 0.0, f"the arm bends, the finger stays {1e3 * off:.0f} mm away")
        clear, links = self._as_drawn.clearance_on(between(np.array(readings)))
        if clear < least:
            return _Lacking(3, 0.0, f"{links} come {1e3 * max(clear, 0.0):.1f} mm near on the way")
        return Touch(read_only(way), read_only(readings), read_only(ends), clear, float(lean))

    def _commands(self, q: NDArray) -> NDArray:
        """Return readings at which the arm's joints stand so, bent by its own weight. (n,)."""
        model, told = self.model, q
        if model.bending is not None:
            for _ in range(_LOADED_ROUNDS):
                told = q - (model.posture(told).q - told)
        return model.servos.to_encoder(told)


def between(way: NDArray, count: int = _BETWEEN) -> NDArray:
    """Return rows of a way with others evenly between them, so many steps from each to the next.

    Args:
        way: Shape (N, n).
        count: Steps, 1 or more.

    Returns:
        Shape ((N - 1) count + 1, n).
    """
    share = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    return np.vstack([*(a + share * (b - a) for a, b in pairwise(way)), way[-1]])


def _angle(a: NDArray, b: NDArray) -> float:
    """Return the angle between directions [rad]."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
