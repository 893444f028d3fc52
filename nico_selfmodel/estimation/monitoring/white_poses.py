"""What a body leaves of a recording by any sensors, pose by pose, in standard deviations.

Coordinates and joint angles are taken in their own standard deviations, so that metres, pixels and
turns stand side by side.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.tree.compared_errors import alone_off, usual_by
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors, told_as
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.tree.body_model import BodyModel


def white_poses(model: BodyModel, data: BodyDataset) -> tuple[PoseResiduals, NDArray] | None:
    """Return what a body leaves of all that saw it, but of what is off on its own.

    Args:
        model: The body.
        data: The recording.

    Returns:
        Residuals by pose, noise of sensors and joints being 1, and how many detections each pose
        has; None where the body does not say the noise of all that saw it, or nothing did.

    Raises:
        DataError: If the recording is of another body.
    """
    told = told_as(model.tree, data)
    kinds = np.array([sensor.kind for sensor in told.sensors])
    seen = TreeObservations.of(told, np.isin(kinds[told.observations.sensor], SIGHTS))
    silent = (name for name in model.tree.joints if f"{name} turn" not in model.noise)
    known = noise_named({**dict.fromkeys(silent, 0.0), **model.noise}, seen)
    if known is None or min(known.sensor, default=0.0) <= 0.0:
        return None
    parameters = TreeParameters(model.tree)
    linear = TreeResiduals(seen, parameters).linear(parameters.values_of(model.tree))
    aside = alone_off(TreeErrors(seen, linear.r), usual_by(linear, known, seen))
    kept = ~aside[seen.row]
    scale = 1.0 / known.sensor[seen.noise_group[kept]]
    white = replace(
        linear,
        r=linear.r[kept] * scale,
        J=linear.J[:, kept] * scale,
        by_joint=linear.by_joint[kept] * scale[:, None] * known.joint,
    )
    row = seen.row[kept]
    pose = told.observations.pose
    detections = np.unique(pose[np.unique(row)], return_counts=True)[1]
    return _stacked(white, pose[row], parameters.names, data.sample), detections


def _stacked(
    linear: TreeLinear, pose: NDArray, names: tuple[str, ...], sample: NDArray
) -> PoseResiduals:
    """Lay scalars into the places of their poses, zeros where there are fewer."""
    poses, of = np.unique(pose, return_inverse=True)
    order = np.argsort(of, kind="stable")
    place = np.empty(len(of), dtype=int)
    count = np.bincount(of)
    place[order] = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    shape = (len(poses), int(count.max()))

    def laid(values: NDArray) -> NDArray:
        out = np.zeros((*shape, *values.shape[1:]))
        out[of, place] = values
        return out

    by_angle = laid(linear.by_joint)
    return PoseResiduals(
        "pixels",
        names,
        laid(-linear.r),
        by_angle,
        np.zeros_like(by_angle),
        laid(linear.J.T),
        laid(np.ones(len(of))) > 0.0,
        sample[poses],
    )
