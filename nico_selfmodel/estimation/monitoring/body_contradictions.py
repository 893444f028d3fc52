"""Poses of a recording, by whatever sensors, that contradict a body of any tree."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.estimation.monitoring.body_health import (
    false_share,
    shown_covariance,
    stacked,
    with_tail,
)
from nico_selfmodel.estimation.noise.contradictions import Contradictions, contradictions
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_errors import told_as
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import FLANGE


def body_contradictions(model: BodyModel, data: BodyDataset) -> Contradictions | None:
    """Return which poses are further off than a body and its sensors' noise explain.

    Coordinates and joint angles are taken in their own standard deviations, so that metres, pixels
    and turns stand side by side.

    Args:
        model: The body.
        data: A recording of it.

    Returns:
        None where the body does not say a sensor's noise, where boards move freely, or nothing but
        distances was measured.

    Raises:
        DataError: If the recording is of another body.
    """
    if data.free_joints:
        return None
    told = told_as(model.tree, data)
    kinds = np.array([sensor.kind for sensor in told.sensors])
    seen = TreeObservations.of(told, np.isin(kinds[told.observations.sensor], SIGHTS))
    known = [model.noise.get(name, 0.0) for name in seen.noise_groups]
    if not known or min(known) <= 0.0:
        return None
    parameters = TreeParameters(model.tree)
    linear = TreeResiduals(seen, parameters).linear(parameters.values_of(model.tree))
    scale = 1.0 / np.array(known)[seen.noise_group]
    white = replace(
        linear,
        r=linear.r * scale,
        J=linear.J * scale,
        by_joint=linear.by_joint * scale[:, None] * _joint_sigmas(model, seen),
    )
    poses = stacked(white, told.observations.pose[seen.row], parameters.names, data.sample)
    one = with_tail(model, 1.0, 1.0)
    counts = np.unique(told.observations.pose[np.unique(seen.row)], return_counts=True)[1]
    return contradictions(poses, one, shown_covariance(model, poses), false_share(counts))


def _joint_sigmas(model: BodyModel, seen: TreeObservations) -> NDArray:
    """Return the noise of all that is read, in the order of `noisy_joints`. Shape (m,)."""
    out = []
    for i, part in seen.noisy_joints:
        joint = seen.data.joints[i]
        suffix = "" if joint.motion != FLANGE else (" turn" if part < 3 else " place")
        out.append(model.noise.get(f"{joint.name}{suffix}", 0.0))
    return np.array(out)
