"""Which reading counts as zero: a choice of words, since no measurement of points can tell."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap


def meaningful_parameters(
    arm: ArmEstimate,
    units: ServoMap,
    gear_known: NDArray,
    nominal: NominalArm | None,
    first_zero: float | None,
    middle: NDArray,
) -> DhParameters:
    """Write an arm as named parameters whose zero a person can use.

    Encoders in rad or deg: q = 0 where the encoder reads zero. Counts with a nominal robot: q = 0
    where theta equals the robot's theta at its own zero, the first joint by its limits where they
    are known. Counts alone: q = theta.

    Args:
        arm: The arm at its reference reading.
        gear_known: Joints read in rad or deg. Shape (n,).
        nominal: The robot, if one was given.
        first_zero: Encoder angle of the robot's zero of joint 1 from limits, if known [rad].
        middle: A typical encoder angle of each joint [rad]. Shape (n,).

    Returns:
        Table and servos; every prediction is that of `arm`.
    """
    like = DhTable.from_chain(nominal.chain) if nominal else None
    table = DhTable.from_chain(arm.chain, like)
    servos = replace(units, offset=arm.zero, gear=arm.gear)
    if first_zero is not None and not gear_known[0]:
        table, servos = _turn_base(table, servos, first_zero)
    theta_offset = servos.offset - servos.gear * table.theta_zero
    theta_zero = like.theta_zero if like else np.zeros(len(arm.gear))
    offset = theta_offset + servos.gear * theta_zero
    if like:
        # q is only known up to whole turns: keep the middle of the data nearest to zero.
        turn = 2.0 * np.pi * servos.gear
        offset = offset + turn * np.round((middle - offset) / turn)
        theta_offset = offset - servos.gear * theta_zero
    offset = np.where(gear_known, 0.0, offset)
    theta_zero = (offset - theta_offset) / servos.gear
    return DhParameters(replace(table, theta_zero=theta_zero), replace(servos, offset=offset))


def _turn_base(table: DhTable, servos: ServoMap, first_zero: float) -> tuple[DhTable, ServoMap]:
    """Move the first joint's zero and turn frame 0 with it, which changes no prediction."""
    angle = (first_zero - servos.offset[0]) / servos.gear[0]
    turn = transform(rotation_about(np.array([0.0, 0.0, 1.0]), angle), np.zeros(3))
    offset = servos.offset.copy()
    offset[0] = first_zero
    return replace(table, X_W0=table.X_W0 @ turn), replace(servos, offset=offset)
