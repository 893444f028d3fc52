"""Poses of a recording, by whatever sensors, that contradict a body of any tree."""

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.monitoring.body_health import (
    false_share,
    shown_covariance,
    with_tail,
)
from nico_selfmodel.estimation.monitoring.white_poses import white_poses
from nico_selfmodel.estimation.noise.contradictions import Contradictions, contradictions
from nico_selfmodel.model.tree.body_model import BodyModel


def body_contradictions(model: BodyModel, data: BodyDataset) -> Contradictions | None:
    """Return which poses are further off than a body and its sensors' noise explain.

    What is off on its own, as a wrong label is, does not count.

    Args:
        model: The body.
        data: A recording of it.

    Returns:
        None where the body does not say a sensor's noise, where boards move freely, or nothing was
        seen.

    Raises:
        DataError: If the recording is of another body.
    """
    found = None if data.free_joints else white_poses(model, data)
    if found is None:
        return None
    poses, share = found.residuals, false_share(found.detections)
    return contradictions(poses, with_tail(model), shown_covariance(model, poses), share)
