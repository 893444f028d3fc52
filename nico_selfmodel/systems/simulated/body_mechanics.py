"""A tree of joints as it was really built, with cameras on links that move."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_tree import WORLD, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.joint_mechanics import (
    GRAVITY,
    JointMechanics,
    built_servos,
    built_stops,
)
from nico_selfmodel.systems.simulated.trunk import limbs_of, put_on_trunk, trunk_of

if TYPE_CHECKING:
    # The plant is slow to load.
    from nico_selfmodel.plant.body_description import BodyDescription

_HELD_SIGMA = np.radians(1.0)
"""How far joints that nobody commands stand from where they should [rad]."""
_WEIGHED = 50
"""Poses from which the largest gravity torque is known."""


@dataclass(frozen=True, eq=False)
class BodyMechanics(JointMechanics):
    """A whole body as it is really built; some of its joints follow commands.

    One seed is one robot: which joints are commanded and what is tracked changes nothing in it.
    """

    tree: BodyTree
    """All joints with their true frames at the zero of the description, gears 1; markers, and
    cameras with their lenses. W is the root link's frame, z up."""
    columns: NDArray
    """Where the commanded joints stand among them. Shape (k,)."""
    rest: NDArray
    """Where joints stand that nobody commands [rad]. Shape (n,)."""

    @classmethod
    def build(
        cls, body: "BodyDescription", imperfections: Imperfections, seed: int, rig: StereoRig
    ) -> "BodyMechanics":
        """Build one instance of a body.

        Args:
            seed: Which one.
            rig: The cameras as built; each `X_WC` is its pose in the frame it is mounted on.

        Raises:
            ValueError: If a limit is missing or crossed, or a joint has no room to move.
        """
        trunk = trunk_of(body.tree)
        if trunk:
            limbs = cls.build(limbs_of(body, trunk), imperfections, seed, rig)
            return limbs._on_trunk(body, trunk, seed)
        rng = np.random.default_rng((seed, 22))
        tree, n = _built_tree(body.tree, imperfections, rng, rig), len(body.tree.joints)
        geared = np.array(["elbow" in name for name in tree.joints])
        gear = np.where(geared, imperfections.extra_gear, 1.0)
        servos = built_servos(tree.joints, gear, imperfections, rng)
        stops = built_stops(servos, *body.limits, imperfections.stop_spread, seed)
        off = _HELD_SIGMA * rng.normal(size=n)
        poses = rng.uniform(*body.limits, (_WEIGHED, n))
        torque = float(np.abs(_torques(tree, poses)).max()) or 1.0
        rest = np.array([body.held.get(name, 0.0) for name in tree.joints]) + off
        lower, upper = (stop[body.columns] for stop in stops)
        return cls(
            tree,
            body.columns,
            rest,
            servos=_some(servos, body.columns),
            lower=lower,
            upper=upper,
            imperfections=imperfections,
            largest_torque=torque,
        )

    def _on_trunk(self, body: "BodyDescription", trunk: int, seed: int) -> "BodyMechanics":
        """Return these limbs on a torso of its own imperfections, which hardly bears a load."""
        rng, flaws, names = (
            np.random.default_rng((seed, 29)),
            self.imperfections,
            body.tree.joints[:trunk],
        )
        off = _axes_off(trunk, flaws, rng)
        tree = put_on_trunk(self.tree, body.tree, body.tree.X_PJ[:trunk] @ off)
        servos = built_servos(names, np.ones(trunk), flaws, rng)
        stops = built_stops(servos, *body.limits[:, :trunk], flaws.stop_spread, seed)
        stand = [body.held.get(name, 0.0) for name in names] + _HELD_SIGMA * rng.normal(size=trunk)
        own = body.columns[body.columns < trunk]
        first, both = _some(servos, own), self.servos
        return replace(
            self,
            tree=tree,
            columns=body.columns,
            rest=np.concatenate([stand, self.rest]),
            servos=ServoMap(
                (*first.joints, *both.joints),
                np.concatenate([first.offset, both.offset]),
                np.concatenate([first.gear, both.gear]),
                (*first.unit, *both.unit),
                np.concatenate([first.counts_per_turn, both.counts_per_turn]),
                np.concatenate([first.sign, both.sign]),
            ),
            lower=np.concatenate([stops[0][own], self.lower]),
            upper=np.concatenate([stops[1][own], self.upper]),
        )

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return tuple(marker.name for marker in self.tree.markers)

    @property
    def loose(self) -> Sequence[int]:
        """The commanded joints of the shoulders."""
        return [i for i, name in enumerate(self.servos.joints) if "shoulder" in name]

    def posture(self, q: NDArray) -> NDArray:
        """Return where all joints are, those that nobody commands at rest. (k,) -> (1, n)."""
        everything = self.rest.copy()
        everything[self.columns] = q
        return everything[None]

    def points(self, q: NDArray) -> NDArray:
        """As `JointMechanics.points`."""
        motion = TreeMotion.at(self.tree, self.posture(q))
        which = np.arange(len(self.tree.markers))
        return motion.points(which, np.zeros_like(which))

    def torques(self, q: NDArray) -> NDArray:
        """As `JointMechanics.torques`."""
        return _torques(self.tree, self.posture(q))[0, self.columns]

    def cameras(self, q: NDArray) -> tuple[NDArray, StereoRig]:
        """As `JointMechanics.cameras`."""
        motion = TreeMotion.at(self.tree, self.posture(q))
        (X_BL, left), (X_BR, right) = (
            (motion.poses(sensor)[0], self.tree.lenses[sensor.name]) for sensor in self.tree.sensors
        )
        return X_BL, StereoRig(left.at(np.eye(4)), right.at(inverse(X_BL) @ X_BR))

    def in_room(self, room: Sequence[Attached]) -> "BodyMechanics":
        """Return the body with more markers, fixed in the room about it."""
        return replace(self, tree=self.tree.with_markers((*self.tree.markers, *room)))


def _built_tree(
    nominal: BodyTree, imperfections: Imperfections, rng: np.random.Generator, rig: StereoRig
) -> BodyTree:
    """Return the axes, points and cameras of one instance: X_PJ (exp(w), v), w and v across z."""
    n, m = len(nominal.joints), len(nominal.markers)
    off = _axes_off(n, imperfections, rng)
    # A card is printed or glued on nearly in its place, and stays in its plane.
    on_card = np.array(
        [[1.0, 1.0, 0.0] if item.oriented else [0.0] * 3 for item in nominal.markers]
    )
    moved = transform(np.eye(3), rng.normal(size=(m, 3)) * on_card * imperfections.link_sigma)
    markers = zip(nominal.markers, moved, strict=True)
    cameras = list(zip(nominal.sensors, rig.cameras, strict=True))
    return replace(
        nominal,
        X_PJ=nominal.X_PJ @ off,
        markers=tuple(replace(item, X_LA=item.X_LA @ X) for item, X in markers),
        sensors=tuple(replace(item, X_LA=item.X_LA @ camera.X_WC) for item, camera in cameras),
        lenses={item.name: camera.at(np.eye(4)) for item, camera in cameras},
    )


def _axes_off(n: int, imperfections: Imperfections, rng: np.random.Generator) -> NDArray:
    """Return how n built axes stand off the described ones: (exp(w), v), across z. (n, 4, 4)."""
    tilt, shift = np.zeros((n, 3)), np.zeros((n, 3))
    tilt[:, :2] = rng.normal(0.0, 1.0, (n, 2)) * imperfections.axis_sigma
    shift[:, :2] = rng.normal(0.0, 1.0, (n, 2)) * imperfections.link_sigma
    return transform(rotation_from_vector(tilt), shift)


def _some(servos: ServoMap, columns: NDArray) -> ServoMap:
    chosen = columns.tolist()
    return ServoMap(
        tuple(servos.joints[i] for i in chosen),
        servos.offset[chosen],
        servos.gear[chosen],
        tuple(servos.unit[i] for i in chosen),
        servos.counts_per_turn[chosen],
        servos.sign[chosen],
    )


def _torques(tree: BodyTree, q: NDArray) -> NDArray:
    """Return tau_i = z_i . sum (p - c_i) x g over unit weights at what joint i carries. (N, n).

    Unit weights are at the joints beyond it, and in the middle of what is fixed to each link.
    """
    motion, n = TreeMotion.at(tree, q), len(tree.joints)
    fixed: dict[int, list[NDArray]] = {}
    for item in (*tree.markers, *tree.sensors):
        if item.on != WORLD:
            fixed.setdefault(item.on, []).append(motion.pose_of(item)[1])
    links = [*range(n), *fixed]
    places = [*motion.p_WJ, *(np.mean(points, axis=0) for points in fixed.values())]
    carried = tree.beyond[links]
    carried[np.arange(n), np.arange(n)] = False
    out = np.zeros((len(q), n))
    for i in range(n):
        arms = np.array(
            [p - motion.p_WJ[i] for p, c in zip(places, carried[:, i], strict=True) if c]
        )
        if len(arms):
            turning = np.cross(arms.sum(axis=0).T, GRAVITY)
            out[:, i] = np.sum(turning * motion.R_WJ[i, :, 2].T, axis=1)
    return out
