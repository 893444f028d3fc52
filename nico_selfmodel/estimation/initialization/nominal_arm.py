"""Starting an estimate from a robot whose description is roughly known."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.initialization.axis_search import project_variables
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.names import listed


@dataclass(frozen=True, eq=False)
class NominalArm:
    """An arm from a robot description, in the description's own frame and zero."""

    chain: Chain
    """Lines at the description's q = 0, in its base link's frame."""
    lower: NDArray
    """Lower joint limits [rad]; -inf where there is none. Shape (n,)."""
    upper: NDArray
    """Upper joint limits [rad]; inf where there is none. Shape (n,)."""
    source: Mapping[str, Any] = field(default_factory=dict)
    """Where it came from: `urdf`, `base_link`, `tip_link`, `held`; goes into the self-model."""

    def for_joints(self, joints: tuple[str, ...]) -> "NominalArm":
        """Return the arm after checking that it has exactly these joints, in this order.

        Raises:
            ModelError: If it has not.
        """
        if self.chain.joints != joints:
            raise ModelError(
                f"the robot's chain has the joints {listed(self.chain.joints)}, the data set "
                f"{listed(joints)}: choose base, tip and held joints so that they agree"
            )
        return self


def nominal_start(
    nominal: NominalArm, dataset: Dataset, observations: Observations, gear_known: NDArray
) -> ArmEstimate | None:
    """Place a nominal arm in the measuring frame and refine its lines.

    Encoders in rad or deg read the description's joint positions. Counts need limits on both
    sides, of the data set's joints and of the description, to tell gear and zero.

    Args:
        dataset: The data, for limits.
        gear_known: Joints whose gear is 1. Shape (n,).

    Returns:
        An arm near the measurements, or None where the encoders' zero cannot be told.
    """
    known = _placed_nominal(nominal, dataset, observations, gear_known)
    if known is None:
        return None
    chain, gear, zero = known.chain, known.gear, known.zero
    start = chain.directions[None], gear[None]
    return project_variables(observations, *start, gear_known, zero, rounds=2)[0]


def _placed_nominal(
    nominal: NominalArm, dataset: Dataset, observations: Observations, gear_known: NDArray
) -> ArmEstimate | None:
    """Place a nominal arm rigidly in the measuring frame, its own geometry kept.

    Its zero configuration stays that of the description; None where the encoders' zero cannot be
    told. Of joints whose gear is known it is 1.
    """
    servo = _servo_from_limits(nominal, dataset, observations, gear_known)
    if servo is None:
        return None
    gear, offset = servo
    q = (observations.angles - offset) / gear
    chain = nominal.chain
    index = {m: k for k, m in enumerate(chain.markers)}
    own = np.array([index.get(m, 0) for m in observations.markers])[observations.marker]
    predicted = chain.forward(q, own)
    try:
        x = Alignment.from_points(predicted, observations.p_WH)
    except ValueError:
        return None
    placed = chain.moved(transform(x.rotation, x.translation))
    hands = np.array([placed.p_WH_zero[index.get(m, 0)] for m in observations.markers])
    renamed = Chain(placed.joints, placed.directions, placed.points, observations.markers, hands)
    return ArmEstimate(renamed, gear, offset)


def _servo_from_limits(
    nominal: NominalArm, dataset: Dataset, observations: Observations, gear_known: NDArray
) -> tuple[NDArray, NDArray] | None:
    """Return gears and the encoder angles at the description's zero, or None."""
    n = len(gear_known)
    gear, offset = np.ones(n), np.zeros(n)
    units = observations.units.radians_per_unit
    for i, joint in enumerate(dataset.joints):
        if gear_known[i]:
            continue
        if joint.lower is None or joint.upper is None:
            return None
        if not np.isfinite([nominal.lower[i], nominal.upper[i]]).all():
            return None
        low, high = sorted((joint.lower * units[i], joint.upper * units[i]))
        gear[i] = (high - low) / (nominal.upper[i] - nominal.lower[i])
        offset[i] = low - gear[i] * nominal.lower[i]
    return gear, offset


def first_joint_zero(
    nominal: NominalArm | None, dataset: Dataset, observations: Observations
) -> float | None:
    """Return the encoder angle [rad] of the robot's zero of joint 1, from limits; None if unknown.

    Points cannot tell it (turning the robot about its first axis looks the same), limits can.
    """
    if nominal is None:
        return None
    only_first = np.arange(len(dataset.joints)) > 0
    servo = _servo_from_limits(nominal, dataset, observations, only_first)
    return None if servo is None else float(servo[1][0])
