"""A self-model put into a robot's words: which way its joints count, and from where.

Points do not tell the zero of an encoder that counts, nor which way the designer of the robot
counts an angle. Both are chosen here so that the learned joint angles are those of the robot's
description. Every prediction, and its covariance, stays the same.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model import DhParameters, DhTable, ParameterCovariance, SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.plant.learned_frames import ON_THE_AXIS, comparable_tables

EVIDENCE = 0.005
"""A joint is turned round only if that improves the agreement of D / reach, r / reach, alpha
and beta with the robot by more than this sum of squares. An axis that all but meets its neighbours
at right angles tells too little."""


def aligned_to(model: SelfModel, nominal: DhTable, X_WB: ArrayLike | None = None) -> SelfModel:
    """Return the same arm with the robot's zeros and senses of rotation.

    Joints read in counts: q_i = 0 where theta_i is the nominal table's at its own zero, up to whole
    turns, and axes point the nominal way where the geometry tells (`D`, or a twist away from 90
    deg; else they stay). The first joint's zero is a gauge: turning the whole robot about its first
    axis looks the same. It stays as it is unless `X_WB` says how the robot stands. A point on the
    last axis does not tell the last joint's zero, which then stays too. Joints read in rad or deg
    mean what they say and are not touched.

    Args:
        model: The arm as learned.
        nominal: The arm as described, `DhTable.from_chain(description.chain)`.
        X_WB: The base link's pose in the measuring frame, roughly; chooses the first joint's zero
            if that is read in counts. Shape (4, 4).

    Returns:
        The same arm: table, servos and covariance in the new words.

    Raises:
        ModelError: If the joints differ.
    """
    if model.joints != nominal.joints:
        raise ModelError(
            f"the self-model has the joints {listed(model.joints)}, the robot "
            f"{listed(nominal.joints)}"
        )
    counts = np.array(model.servos.unit) == "counts"
    described, learned = comparable_tables(nominal.to_chain(), model.chain)
    z = _Senses.matching(learned, described, counts).z
    senses = _Senses.in_form_of(z, model.dh, described)
    servos = replace(
        model.servos,
        sign=senses.z * model.servos.sign,
        offset=senses.z * model.servos.offset,
    )
    table = senses.table(model.dh)
    described, learned = comparable_tables(nominal.to_chain(), table.to_chain())
    shift = _wrapped(described.theta_zero - learned.theta_zero) * counts
    if abs(described.r[-1]) < ON_THE_AXIS:
        shift[-1] = 0.0
    if X_WB is not None and counts[0]:
        shift[0] = _turn_towards(learned.X_W0, np.asarray(X_WB) @ described.X_W0)
    shift[np.abs(shift) < 1e-12] = 0.0  # what is aligned stays as it is, to the last bit
    return replace(
        model,
        table=replace(table, theta_zero=table.theta_zero + shift),
        servo_map=servos.rezeroed(shift),
        covariance=senses.covariance(model),
    )


@dataclass(frozen=True, eq=False)
class _Senses:
    """Axes of Denavit-Hartenberg frames that are turned round: z'_i-1 = z_i z_i-1, x'_i = x_i x_i.

    The rows then hold D' = z D, theta' = z (theta + k pi), r' = x r, alpha' = x (alpha [+ pi]) and
    beta' = x z_next beta, which moves nothing.
    """

    z: NDArray
    """+1 or -1 for each joint's axis. Shape (n,)."""
    x: NDArray
    """+1 or -1 for each row's common normal; x_0 follows x_1. Shape (n,)."""

    @classmethod
    def matching(cls, learned: DhTable, nominal: DhTable, free: NDArray) -> "_Senses":
        """Choose the senses that bring a table nearest to the nominal one; few are turned."""
        best, least = cls(np.ones(len(free)), np.ones(len(free))), np.inf
        for z in product(*((1.0, -1.0) if turnable else (1.0,) for turnable in free)):
            senses = cls.in_form_of(np.array(z), learned, nominal)
            cost = senses.distance(learned, nominal) + EVIDENCE * z.count(-1.0)
            if cost < least:
                best, least = senses, cost
        return best

    @classmethod
    def in_form_of(cls, z: NDArray, table: DhTable, nominal: DhTable) -> "_Senses":
        """Give each common normal the sign that the nominal table's has."""
        radial = nominal.parallel.copy()
        radial[-1] = True
        opposed = z * np.append(z[1:], z[-1])
        flipped = np.where(radial, table.r < 0.0, opposed * np.sin(table.alpha) < 0.0)
        return cls(z, np.where(flipped == nominal.flipped, 1.0, -1.0))

    @property
    def nothing_turned(self) -> bool:
        """Whether all senses stay."""
        return bool(np.all(self.z > 0.0) and np.all(self.x > 0.0))

    @property
    def z_next(self) -> NDArray:
        """Signs of the z axes after each row; the last frame follows the last joint's."""
        return np.append(self.z[1:], self.z[-1])

    def half_turns(self, table: DhTable) -> NDArray:
        """Return k, the half turns that join theta where two common normals differ. Shape (n,)."""
        differ = np.append(False, self.x[1:] != self.x[:-1])
        return np.where(differ, np.where(table.theta_zero > 0.0, -1.0, 1.0), 0.0)

    def table(self, table: DhTable) -> DhTable:
        """Write a table in the new senses."""
        x, z = self.x, self.z
        if self.nothing_turned:
            return table
        opposite = np.where(z != self.z_next, np.pi, 0.0)
        return replace(
            table,
            X_W0=table.X_W0 @ transform(self._turn(0), np.zeros(3)),
            D=z * table.D,
            theta_zero=z * (table.theta_zero + np.pi * self.half_turns(table)),
            r=x * table.r,
            alpha=_wrapped(x * (table.alpha + opposite)),
            beta=x * self.z_next * table.beta,
            p_NH=table.p_NH @ self._turn(-1),
        )

    def distance(self, learned: DhTable, nominal: DhTable) -> float:
        """Return the squared distance of a table in these senses to the nominal one."""
        reach = np.sum(np.abs(nominal.D) + np.abs(nominal.r)) or 1.0
        own = self.table(learned)
        return float(
            np.sum((own.D - nominal.D) ** 2 + (own.r - nominal.r) ** 2) / reach**2
            + np.sum(_wrapped(own.alpha - nominal.alpha) ** 2 + (own.beta - nominal.beta) ** 2)
        )

    def covariance(self, model: SelfModel) -> ParameterCovariance | None:
        """Return the covariance of the parameters in the new senses."""
        if model.covariance is None or self.nothing_turned:
            return model.covariance
        parameters = model.parameters
        names = parameters.names
        known = [names.index(name) for name in model.covariance.names]
        jacobian = self._jacobian(parameters)[:, known]
        # A parameter that was pinned in the old words may depend on free ones in the new.
        kept = np.flatnonzero(
            np.any(jacobian != 0.0, axis=1) | np.isin(np.arange(len(names)), known)
        )
        jacobian = jacobian[kept]
        matrix = jacobian @ model.covariance.matrix @ jacobian.T
        return ParameterCovariance(tuple(names[i] for i in kept), matrix)

    def _jacobian(self, parameters: DhParameters) -> NDArray:
        """Return d(parameters in the new senses) / d(parameters). Shape (P, P)."""
        n, m = len(self.z), len(parameters.table.markers)
        rows = np.stack([self.z, self.z, self.x, self.x, self.x * self.z_next, np.ones(n)], axis=1)
        diagonal = np.concatenate([np.ones(6), rows.ravel(), np.tile(np.diag(self._turn(-1)), m)])
        jacobian = np.diag(diagonal)
        jacobian[3:6, 3:6] = _rotation_vector_jacobian(parameters.table.X_W0, self._turn(0))
        for i, k in enumerate(self.half_turns(parameters.table)):
            column = 6 + 6 * i  # D, theta_offset, ..., gear
            jacobian[column + 1, column + 5] = -self.z[i] * k * np.pi
        return jacobian

    def _turn(self, frame: int) -> NDArray:
        """Return the half turn (or none) of the first (0) or the last frame (-1)."""
        x, z = self.x[frame], self.z[frame]
        return np.diag([x, x * z, z])


def _rotation_vector_jacobian(x: NDArray, turn: NDArray) -> NDArray:
    """Return d(rotation vector of R turn) / d(rotation vector of R), by differences. (3, 3)."""
    if np.array_equal(turn, np.eye(3)):
        return np.eye(3)
    vector, step, columns = rotation_vector_of(x[:3, :3]), 1e-5, []
    for direction in step * np.eye(3):
        plus = rotation_vector_of(rotation_from_vector(vector + direction) @ turn)
        minus = rotation_vector_of(rotation_from_vector(vector - direction) @ turn)
        if np.linalg.norm(plus - minus) > np.pi:  # a rotation of pi has two vectors
            minus = minus - 2.0 * np.pi * minus / np.linalg.norm(minus)
        columns.append((plus - minus) / (2.0 * step))
    return np.stack(columns, axis=1)


def _turn_towards(x: NDArray, wanted: NDArray) -> float:
    """Return the turn about z of frame `x` that brings its axes nearest to those wanted [rad]."""
    r = x[:3, :3].T @ wanted[:3, :3]
    return float(np.arctan2(r[1, 0] - r[0, 1], r[0, 0] + r[1, 1]))


def _wrapped(angle: NDArray) -> NDArray:
    """Return angles in (-pi, pi]."""
    return -((-angle + np.pi) % (2.0 * np.pi) - np.pi)
