"""Arms that sag by physics: Drake's masses and gravity, and joints that give way under them.

Their masses are motors and shells, not rods, so that the estimator never meets its own model.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia, UnitInertia

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.estimation.noise.pose_refinement import refine_by_pose
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.arm.uniform_rods import uniform_rods

AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], dtype=float)
PLACES = np.array(
    [[0, 0, 0], [0.05, 0, 0.35], [0.05, 0, 0.75], [0.25, 0, 0.8], [0.5, 0, 0.8], [0.55, 0, 0.8]]
)
SOFT = np.array([1.0, 1.0, 1.0, 1.5, 2.0, 2.0]) * 6e-5
"""Of a joint about as stiff as an industrial one [rad/(N m)]."""
GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class SaggingArm:
    """The truth: joints read in radians, whose encoders sit before what gives way."""

    directions: np.ndarray
    points: np.ndarray
    hands: np.ndarray
    masses: tuple
    """Of each link, (mass [kg], place at zero [m])."""
    give: np.ndarray
    """[rad/(N m)]. Shape (n,)."""
    bearing: np.ndarray
    """[rad/(N m)]. Shape (n,)."""
    ripple: np.ndarray
    """Sine and cosine of one and two turns [rad]. Shape (n, 2, 2)."""
    gear: np.ndarray
    """Joint angle per angle read. Shape (n,)."""
    backlash: np.ndarray
    """Half width of the gap that a joint is behind by [rad]. Shape (n,)."""
    plant: MultibodyPlant
    """Links with their masses, all frames those of the world at zero."""

    @classmethod
    def drawn(
        cls,
        rng,
        *,
        sag=1.0,
        bearing=0.0,
        ripple=0.0,
        gear=0.0,
        backlash=0.0,
        markers=1,
        mounted=None,
    ):
        """An arm of six joints with links, masses and weaknesses of its own."""
        n = len(AXES)
        directions = AXES + 0.02 * rng.normal(size=(n, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        points = PLACES * rng.uniform(0.8, 1.2, (n, 1)) + 0.01 * rng.normal(size=(n, 3))
        hand = points[-1] + [0.12, 0.03, -0.05] + 0.02 * rng.normal(size=3)
        hands = np.vstack([hand, hand + 0.08 * rng.normal(size=(markers - 1, 3))])
        ends = np.vstack([points, hand])
        masses = tuple(
            tuple(
                (
                    rng.uniform(0.2, 1.5) * (0.5 if j > 3 else 1.5),
                    ends[j]
                    + rng.uniform(-0.1, 1.1) * (ends[j + 1] - ends[j])
                    + 0.04 * rng.normal(size=3),
                )
                for _ in range(rng.integers(1, 4))
            )
            for j in range(n)
        )
        give = sag * rng.uniform(0.3, 1.5, n) * SOFT
        tilt = bearing * rng.uniform(0.3, 1.5, n) * 3e-5
        waves = ripple * rng.normal(size=(n, 2, 2)) * np.radians([[0.03], [0.015]])
        gears = 1.0 + 2e-3 * gear * rng.normal(size=n)
        gaps = np.radians(backlash) * (rng.uniform(0.7, 1.3, n) if backlash else np.zeros(n))
        if mounted is not None:
            directions, points, hands = (v @ mounted.T for v in (directions, points, hands))
            masses = tuple(tuple((mass, mounted @ p) for mass, p in own) for own in masses)
        plant = _plant(directions, points, masses)
        return cls(directions, points, hands, masses, give, tilt, waves, gears, gaps, plant)

    def hand(self, read, marker=0, side=0.0):
        """Where a tracked point is at angles read, in static balance. Shape (n,) -> (3,)."""
        context = self.plant.CreateDefaultContext()
        turned = self.gear * read - self.backlash * side
        for h in (1, 2):
            turned = turned + self.ripple[:, h - 1, 0] * np.sin(h * read)
            turned = turned + self.ripple[:, h - 1, 1] * np.cos(h * read)
        q = turned
        for _ in range(5):
            self.plant.SetPositions(context, q)
            q = turned + self.give * self.plant.CalcGravityGeneralizedForces(context)
        self.plant.SetPositions(context, q)
        p = self._at(context, len(q) - 1) @ self.hands[marker]
        for i in range(len(q)):
            X = self._at(context, i - 1)
            foot, axis = X @ self.points[i], X.rotation() @ self.directions[i]
            moment = sum(
                np.cross(self._at(context, j) @ place - foot, [0.0, 0.0, -GRAVITY * mass])
                for j in range(i, len(q))
                for mass, place in self.masses[j]
            )
            # Milliradians: what bearings add to each other is nothing.
            turn = self.bearing[i] * (moment - axis * (axis @ moment))
            p = p + np.cross(turn, p - foot)
        return p

    def _at(self, context, link):
        if link < 0:
            return RigidTransform()
        body = self.plant.GetBodyByName(f"link{link}")
        return self.plant.EvalBodyPoseInWorld(context, body)

    def recorded(self, rng, poses, *, sigma=1e-4, span=1.3, q=None, name="sagging"):
        """A recording at random poses, and the true places."""
        q = rng.uniform(-span, span, (poses, len(self.gear))) if q is None else q
        count = len(self.hands)
        side = np.sign(np.diff(q, axis=0, prepend=np.zeros((1, q.shape[1]))))
        true = np.array(
            [self.hand(row, k, s) for row, s in zip(q, side, strict=True) for k in range(count)]
        )
        return Dataset(
            name,
            tuple(JointInfo(f"j{i + 1}", "rad") for i in range(len(self.gear))),
            np.repeat(np.arange(len(q)), count),
            np.repeat(q, count, axis=0),
            true + sigma * rng.normal(size=true.shape),
            approach=np.repeat(side, count, axis=0) if self.backlash.any() else None,
            marker=np.tile([f"m{k}" for k in range(count)], len(q)),
            point_sigma_m=sigma,
        ), true


def _plant(directions, points, masses):
    """The arm in Drake, every link's frame that of the world at zero."""
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    parent = plant.world_body()
    for i, (d, c) in enumerate(zip(directions, points, strict=True)):
        weight = sum(mass for mass, _ in masses[i])
        centre = sum(mass * place for mass, place in masses[i]) / weight
        inertia = SpatialInertia(
            weight, centre, UnitInertia.SolidSphere(0.5).ShiftFromCenterOfMass(centre)
        )
        link = plant.AddRigidBody(f"link{i}", inertia)
        X = RigidTransform(RotationMatrix.MakeFromOneVector(d, 2), c)
        joint = RevoluteJoint(
            f"joint{i}",
            plant.AddFrame(_fixed(f"F{i}", parent, X)),
            plant.AddFrame(_fixed(f"M{i}", link, X)),
            [0.0, 0.0, 1.0],
        )
        plant.AddJoint(joint)
        parent = link
    plant.Finalize()
    return plant


def _fixed(name, body, X):
    from pydrake.multibody.tree import FixedOffsetFrame

    return FixedOffsetFrame(name, body.body_frame(), X)


def told(arm, calibration, train):
    """The rigid parameters refined with the true effects and loads held: what could be reached."""
    parameters = replace(calibration.model.parameters, bending=None)
    table, servos = parameters.table, parameters.servos
    frames = table.frames(np.zeros(len(table.joints)))
    _, pivots = uniform_rods(table)
    feet = frames[:-1, :3, 3] + pivots[:, None] * frames[:-1, :3, 2]
    context = arm.plant.CreateDefaultContext()
    arm.plant.SetPositions(context, arm.gear * servos.offset)
    weights = np.array([sum(mass for mass, _ in own) for own in arm.masses])
    ends = np.vstack([feet, feet[-1:]])
    loads = []
    for j, own in enumerate(arm.masses):
        X = arm._at(context, j)
        L = sum(mass * (X @ place - feet[j]) for mass, place in own)
        L = L + weights[j + 1 :].sum() * (ends[j + 1] - feet[j])
        loads.append(frames[j + 1, :3, :3].T @ L / weights.sum())
    joints, n = table.joints, len(table.joints)
    force = GRAVITY * weights.sum()
    # Waves of what is read, about the arm's own zero.
    ripple = np.zeros((n, 2, 2))
    for h in (1, 2):
        s, c = np.sin(h * servos.offset), np.cos(h * servos.offset)
        a, b = arm.ripple[:, h - 1].T
        ripple[:, h - 1] = np.stack([a * c - b * s, a * s + b * c], axis=1)
    none = np.zeros((n, n))
    bending = Bending(
        joints, ("sag", "bearing_sag", "ripple"), np.array([0.0, 0.0, 1.0]), np.array(loads),
        pivots, arm.give * force, arm.bearing * force, np.zeros(n), ripple, none,
    )  # fmt: skip
    known = replace(parameters, bending=bending)
    values = dict(zip(known.names, known.values, strict=True))
    gears = {f"{joint}.gear": 1.0 / g for joint, g in zip(joints, arm.gear, strict=True)}
    known = known.with_values(np.array([*(values | gears).values()]))
    observations = Observations.from_dataset(train)
    rigid = frozenset(parameters.names) - parameters.gauge - set(gears)
    nothing = np.zeros(len(observations), dtype=bool)
    return refine_by_pose(observations, known, rigid, nothing, 1e-4).parameters


def mean_mm(parameters, test, true):
    """Mean distance from the true places [mm]."""
    observations = Observations.from_dataset(test)
    p = parameters.points(observations.angles, observations.marker)
    return 1e3 * float(np.linalg.norm(p - true, axis=1).mean())
