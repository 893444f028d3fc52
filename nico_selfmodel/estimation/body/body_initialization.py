"""Initial guess of a whole body: an arm before its cameras, in the left camera's frame."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.matching import check_images
from nico_selfmodel.estimation.observations.observations import gears_known
from nico_selfmodel.estimation.observations.pixel_observations import (
    PixelObservations,
    columns_of,
    seen_points,
)
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.self_model import SelfModel


def in_left_camera(model: SelfModel) -> SelfModel:
    """Return a model whose world is its left camera's frame; if it was, its covariance stays.

    Raises:
        ModelError: If it has not both cameras.
    """
    rig = model.rig
    if np.array_equal(rig.left.X_WC, np.eye(4)):
        return model
    moved = rig.moved(rig.left.X_WC)
    table = model.table
    if table is not None:
        table = replace(table, X_W0=rig.left.X_CW @ table.X_W0)
    cameras = {"left": moved.left.at(np.eye(4)), "right": moved.right}
    return replace(model, table=table, cameras=cameras, covariance=None)


def reconstructed(dataset: Dataset, model: SelfModel, pinned: frozenset[str] | None) -> Dataset:
    """Return the rows that both cameras saw, with the points that they reconstruct from them.

    The thesis' chapter 7: what stereo measures takes the place of motion capture.

    Args:
        pinned: Parameters that are known where an arm is to be learned from the points alone;
            None where nothing is to be learned.

    Returns:
        Data with measured points in the left camera's frame and without pixels.

    Raises:
        DataError: If images are of another size, or too few rows were seen by both cameras.
        ModelError: If the model has not both cameras.
    """
    model = in_left_camera(model)
    check_images(model, dataset)
    observations = PixelObservations.from_dataset(dataset)
    unknown = () if pinned is None else _unknown(observations, pinned)
    # Each pose that both cameras saw gives three equations.
    fewest = max(-(-len(unknown) // 3), 1)
    observations.require_both_cameras(fewest, dataset.name, unknown)
    p_LH = seen_points(observations, model.rig, dataset.pixel_sigma_px or 1.0)
    there = np.isfinite(p_LH).all(axis=1)
    chosen = dataset.select(observations.arm.rows[there])
    return replace(chosen, p_WH_measured=p_LH[there], pixels=None, point_sigma_m=None)


def body_start(
    dataset: Dataset,
    model: SelfModel,
    nominal: NominalArm | None,
    seed: int,
    pinned: frozenset[str] = frozenset(),
) -> tuple[SelfModel, Dataset, str]:
    """Return an arm with its cameras to start from.

    Args:
        model: Cameras, and the arm if it is known already.
        nominal: The robot as described, for the zero of the joints and as a start.
        seed: Of random starts, where the arm is learned from scratch.
        pinned: Parameters that are known.

    Returns:
        A self-model in the left camera's frame, the data with its joints in the model's order, and
        where the arm came from: `model` or `stereo`.

    Raises:
        DataError: If the data do not suit the model, or too few poses were seen.
        ModelError: If the model has not both cameras.
    """
    model = in_left_camera(model)
    if model.has_arm:
        return model, columns_of(model, dataset), "model"
    points = reconstructed(dataset, model, pinned)
    learned = calibrate_kinematics(points, nominal=nominal, seed=seed, explain=False).model
    arm = replace(learned, name=model.name, cameras=model.cameras, pixel_sigma=model.pixel_sigma)
    return arm, dataset, "stereo"


def _unknown(observations: PixelObservations, pinned: frozenset[str]) -> tuple[str, ...]:
    """Return the parameters of an arm of which nothing is known but its joints and points.

    Fewer equations than these leave all of them open, each at least in part.
    """
    arm = observations.arm
    n = len(arm.joints)
    twist, still = np.full(n, 0.5 * np.pi), np.zeros(n)
    hands = np.zeros((len(arm.markers), 3))
    table = DhTable(arm.joints, np.eye(4), still, still, still, twist, still, arm.markers, hands)
    parameters = DhParameters(table, arm.units)
    known = zip(arm.joints, gears_known(arm.units), strict=True)
    held = parameters.gauge | pinned | {f"{joint}.gear" for joint, gear in known if gear}
    return tuple(name for name in parameters.names if name not in held)


def lines_of(model: SelfModel, markers: tuple[str, ...]) -> ArmEstimate:
    """Return a model's arm as lines, each point on its axis nearest to the hand, at q = 0.

    Args:
        markers: Tracked points to keep, in this order.
    """
    chain = model.chain
    hands = np.stack([chain.p_WH_zero[chain.marker_index(m)] for m in markers])
    along = np.sum(chain.directions * (hands[0] - chain.points), axis=1)
    points = chain.points + along[:, None] * chain.directions
    lines = replace(chain, points=points, markers=markers, p_WH_zero=hands)
    return ArmEstimate(lines, model.servos.gear, model.servos.offset)


def named_like(arm: ArmEstimate, like: SelfModel, gear_known: NDArray) -> DhParameters:
    """Write lines as named parameters whose gauge and zeros are those of another model.

    Joints read in counts keep the model's theta at zero, those read in rad or deg its offset.

    Args:
        arm: Lines, gears, and encoder angles at their zero.
        like: A model of the same joints.
        gear_known: Joints read in rad or deg. Shape (n,).

    Returns:
        Parameters that predict what the lines do.
    """
    table = DhTable.from_chain(arm.chain, like.dh)
    theta_offset = arm.zero - arm.gear * table.theta_zero
    offset = theta_offset + arm.gear * like.dh.theta_zero
    offset = np.where(gear_known, like.servos.offset, offset)
    theta_zero = (offset - theta_offset) / arm.gear
    servos = replace(like.servos, offset=offset, gear=arm.gear)
    return DhParameters(replace(table, theta_zero=theta_zero), servos)
