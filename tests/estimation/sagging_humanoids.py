"""A humanoid that sags by physics: two arms on a torso, Drake's masses, joints that give way.

Its chest follows the torso so that it stays upright. Masses are motors and shells, not rods, so
that the estimator never meets its own model.
"""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint, coupling_of, parents_of
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.estimation.tree.tree_setup import Description
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.bending import BEARING, SAG, Bending
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree

from .simulated_trees import LENS, looking_at, turned

GRAVITY = 9.81
_Z, _Y, _X = np.eye(3)[2], np.eye(3)[1], np.eye(3)[0]
_ARM = (
    (_Y, (0.0, 0.0, 0.0)),
    (_X, (0.0, 0.04, 0.0)),
    (_Z, (0.0, 0.0, -0.12)),
    (_Y, (0.0, 0.0, -0.14)),
    (_Z, (0.0, 0.0, -0.11)),
    (_X, (0.0, 0.0, -0.12)),
)
"""Axes, and places after the one before [m]."""
SOFT = 4e-4
"""Of its joints [rad/(N m)]: belts and plastic."""


def _frame(axis, place):
    """A joint frame whose z is the axis, on a link whose frame is as the world at zero."""
    R = np.eye(3) if axis is _Z else rotation_about(np.cross(_Z, axis), np.pi / 2.0)
    return transform(R, place)


@dataclass(frozen=True, eq=False)
class SaggingHumanoid:
    """The truth."""

    tree: BodyTree
    masses: tuple
    """Of each link, [(mass [kg], place on it [m])]."""
    give: np.ndarray
    """[rad/(N m)] of each joint that is read. Shape (n,)."""
    bearing: np.ndarray
    """[rad/(N m)]. Shape (n,)."""
    pivots: np.ndarray
    """Places of the bearings along their axes [m]. Shape (n,)."""
    plant: MultibodyPlant
    joints: tuple

    @classmethod
    def drawn(cls, rng, *, sag=1.0, bearing=0.0, markers=1):
        """A humanoid with lengths, masses and weaknesses of its own."""
        joints = [LinkJoint("torso"), LinkJoint("chest", parent="torso", follows={"torso": -1.0})]
        frames = [_frame(_Y, (0.0, 0.0, 0.6)), _frame(_Y, (0.0, 0.0, 0.25))]
        for side, sign in (("l", 1.0), ("r", -1.0)):
            before, last = "chest", np.eye(4)
            last = frames[1]
            for k, (axis, place) in enumerate(_ARM):
                at = np.array(place) * rng.uniform(0.85, 1.15)
                if k == 0:
                    at = np.array([0.0, sign * 0.18 * rng.uniform(0.9, 1.1), 0.22])
                joints.append(LinkJoint(f"{side}{k + 1}", parent=before))
                down = last[:3, :3].T  # links' frames turn with their joint frames
                frames.append(transform(down, np.zeros(3)) @ _frame(axis, at))
                before, last = f"{side}{k + 1}", _frame(axis, at)
        frames = [X @ turned(rng, 1.0, 4.0) for X in frames]
        infos, attached = [], []
        n = len(joints)
        names = [j.name for j in joints]
        for side in "lr":
            on = names.index(f"{side}6")
            R = _frame(_X, (0.0, 0.0, 0.0))[:3, :3].T
            for m in range(markers):
                infos.append(MarkerInfo(f"{side}_hand{m}", f"{side}6"))
                at = R @ (np.array([0.02, 0.01, -0.1]) + 0.04 * rng.normal(size=3))
                attached.append(Attached(f"{side}_hand{m}", on, transform(np.eye(3), at)))
        tree = BodyTree(
            tuple(names),
            ("revolute",) * n,
            parents_of(tuple(joints)),
            np.stack(frames),
            np.ones(n),
            coupling_of(tuple(joints)),
            tuple(attached),
            (Attached("tracker", -1),),
        )
        masses = tuple(
            tuple(
                (rng.uniform(0.2, 0.8) * (4.0 if i < 2 else 1.0), 0.06 * rng.normal(size=3))
                for _ in range(rng.integers(1, 3))
            )
            for i in range(n)
        )
        give = sag * rng.uniform(0.3, 1.5, n) * SOFT * np.where(np.arange(n) < 2, 0.2, 1.0)
        tilt = bearing * rng.uniform(0.3, 1.5, n) * 0.5 * SOFT
        tilt[:2] *= 0.2
        plant = _plant(tree, masses)
        return cls(tree, masses, give, tilt, 0.02 * rng.normal(size=n), plant, tuple(joints))

    def postures(self, read):
        """Where links and markers are in static balance. Shape (P, n) -> (P, markers, 3)."""
        tree, plant = self.tree, self.plant
        context = plant.CreateDefaultContext()
        bodies = [plant.GetBodyByName(f"link{i}") for i in range(len(tree.joints))]
        out = []
        for row in read:
            q = tree.coupling @ row
            for _ in range(5):
                plant.SetPositions(context, q)
                felt = tree.coupling.T @ plant.CalcGravityGeneralizedForces(context)
                q = tree.coupling @ (row + self.give * felt)
            plant.SetPositions(context, q)
            X = [plant.EvalBodyPoseInWorld(context, body) for body in bodies]
            p = np.array([X[m.on] @ m.X_LA[:3, 3] for m in tree.markers])
            out.append(p + self._tilted(X, p))
        return np.array(out)

    def _tilted(self, X, p):
        """How bearings move the markers: milliradians add up."""
        moved, beyond = np.zeros(p.shape), self.tree.beyond
        pieces = [(X[j] @ at, mass) for j, own in enumerate(self.masses) for mass, at in own]
        link = [j for j, own in enumerate(self.masses) for _ in own]
        for i, X_L in enumerate(X):
            axis = X_L.rotation().matrix()[:, 2]
            foot = X_L.translation() + self.pivots[i] * axis
            moment = sum(
                (
                    np.cross(at - foot, [0.0, 0.0, -GRAVITY * mass])
                    for (at, mass), j in zip(pieces, link, strict=True)
                    if beyond[j, i]
                ),
                np.zeros(3),
            )
            turn = self.bearing[i] * (moment - axis * (axis @ moment))
            own = np.array([beyond[m.on, i] for m in self.tree.markers])
            moved[own] += np.cross(turn, p[own] - foot)
        return moved

    def recorded(self, rng, poses, *, sigma=3e-4, hands="lr", cameras=False):
        """A recording by motion capture of some hands, or by two cameras; and the true places."""
        n = len(self.joints)
        q = rng.uniform(-1.2, 1.2, (poses, n))
        q[:, 0] *= 0.4
        q[:, 1] = 0.0
        true = self.postures(q)
        seen = [k for k, m in enumerate(self.tree.markers) if m.name[0] in hands]
        if cameras:
            return self._filmed(rng, q, true[:, seen], seen), true[:, seen]
        rows = len(seen) * poses
        values = np.full((rows, 6), np.nan)
        values[:, :3] = true[:, seen].reshape(-1, 3) + sigma * rng.normal(size=(rows, 3))
        table = ObservationTable(
            np.repeat(np.arange(poses), len(seen)),
            np.zeros(rows, int),
            np.tile(np.arange(len(seen)), poses),
            np.full(rows, -1),
            values,
        )
        readings = q.copy()
        readings[:, 1] = np.nan
        markers = tuple(
            MarkerInfo(self.tree.markers[k].name, self.joints[self.tree.markers[k].on].name)
            for k in seen
        )
        sensors = (SensorInfo("tracker", "points", sigma=sigma),)
        return BodyDataset(
            "humanoid", self.joints, markers, sensors, np.arange(poses), readings, table
        ), true[:, seen]

    def _filmed(self, rng, q, true, seen, sigma=0.3):
        """What two cameras before it see, whose lenses are known."""
        poses, count = true.shape[:2]
        places = [looking_at(np.array([1.8, y, 1.2]), [0.0, 0.0, 0.8]) for y in (-0.3, 0.4)]
        tables = []
        for s, X_WC in enumerate(places):
            values = np.full((poses * count, 6), np.nan)
            pixels = LENS.at(X_WC).project(true.reshape(-1, 3))
            values[:, :2] = pixels + sigma * rng.normal(size=pixels.shape)
            inside = (values[:, :2] > 0) & (values[:, :2] < np.array(LENS.image_size))
            rows = np.flatnonzero(inside.all(axis=1))
            tables.append((rows // count, np.full(len(rows), s), rows % count, values[rows]))
        pose, sensor, marker, values = (np.concatenate(c) for c in zip(*tables, strict=True))
        table = ObservationTable(pose, sensor, marker, np.full(len(pose), -1), values)
        lens = dict(LENS.named_values)
        sensors = tuple(
            SensorInfo(n, "camera", image_size=LENS.image_size, lens=lens) for n in ("one", "two")
        )
        markers = tuple(
            MarkerInfo(self.tree.markers[k].name, self.joints[self.tree.markers[k].on].name)
            for k in seen
        )
        readings = q.copy()
        readings[:, 1] = np.nan
        return BodyDataset(
            "filmed", self.joints, markers, sensors, np.arange(poses), readings, table
        )

    def described(self, rng, data, degrees=2.0, millimetres=10.0):
        """The robot as its description has it, a little off."""
        known = {marker.name for marker in data.markers}
        X = np.stack([X @ turned(rng, degrees, millimetres) for X in self.tree.X_PJ])
        markers = tuple(m for m in self.tree.markers if m.name in known)
        sensors = tuple(Attached(s.name, -1) for s in data.sensors)
        lenses = {s.name: LENS for s in data.sensors if s.kind == "camera"}
        off = replace(self.tree, X_PJ=X, markers=markers, sensors=sensors, lenses=lenses)
        return Description(off)

    def bending(self):
        """What bends in truth, as a body's model has it."""
        tree = self.tree
        n = len(tree.joints)
        mass = np.array([sum(m for m, _ in own) for own in self.masses])
        carried = tree.beyond[:-1].T @ mass
        foot = self.pivots[:, None] * _Z
        loads = np.zeros((n, 3))
        for i, own in enumerate(self.masses):
            loads[i] = sum(m * (at - foot[i]) for m, at in own)
            for k in np.flatnonzero(tree.parent == i):
                at = tree.X_PJ[k, :3, :3] @ foot[k] + tree.X_PJ[k, :3, 3]
                loads[i] += carried[k] * (at - foot[i])
        total = mass.sum()
        effects = (SAG, BEARING) if self.bearing.any() else (SAG,)
        still = Bending.none(tree.joints, _Z, loads / total, self.pivots).with_effects(*effects)
        newtons = total * GRAVITY
        parts = [self.give * newtons, self.bearing * newtons][: len(effects)]
        return still.with_values(np.concatenate(parts))


def _plant(tree, masses):
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    for i, own in enumerate(masses):
        total = sum(m for m, _ in own)
        at = sum(m * p for m, p in own) / total
        inertia = SpatialInertia(
            total, at, UnitInertia.SolidSphere(0.05).ShiftFromCenterOfMass(-at)
        )
        body = plant.AddRigidBody(f"link{i}", inertia)
        parent = tree.parent[i]
        frame = plant.world_frame() if parent < 0 else plant.GetFrameByName(f"link{parent}")
        X = RigidTransform(RotationMatrix(tree.X_PJ[i, :3, :3]), tree.X_PJ[i, :3, 3])
        plant.AddJoint(RevoluteJoint(f"q{i}", _fixed(plant, frame, X, i), body.body_frame(), _Z))
    plant.Finalize()
    return plant


def _fixed(plant, frame, X, i):
    return plant.AddFrame(FixedOffsetFrame(f"before{i}", frame, X))
