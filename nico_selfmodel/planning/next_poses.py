"""Which poses to record next: those that tell a learned arm most beyond what it was learned from.

The poses that were recorded say how far each joint is known to go, and where the hand must be
predicted well. What is known is the covariance C = L L' of the arm's parameters: in z, with
x = L z, all that was recorded says as much as the unit matrix. A pose adds what it says beyond the
noise there.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.arm.evaluation import noise_at
from nico_selfmodel.estimation.observations.pixel_observations import columns_of
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.optimization.uncertainty import root_of
from nico_selfmodel.planning.pose_selection import (
    NextPoses,
    choose_poses,
    drawn_between,
    hand_sigma,
)

POOL = 3000
"""Poses to choose from."""
_DRAWS = 20
"""Times the pool that is drawn at most to find poses in view."""
_MARGIN = 0.03
"""Share of the image at each edge in which a planned hand is not trusted to be seen."""


def choose_next_poses(
    model: SelfModel,
    data: Dataset,
    count: int,
    rng: np.random.Generator,
    *,
    criterion: str = "I",
    marker: str | None = None,
) -> NextPoses:
    """Choose poses within the ranges that were recorded, in view where the model has cameras.

    The marker's error is by what the arm is uncertain of [m]. What a pose tells is weighed by the
    noise there: of the sensor, and of the joints by their levers.

    That a body does not collide in a pose is not known here: only the ranges of single joints are.

    Args:
        model: What was learned from the data.
        criterion: `I` for the prediction of the hand, `D` for all parameters.
        marker: Tracked point; the first of the model by default.

    Raises:
        DataError: If the data are of other joints, units or images, or no pose is in view.
        ModelError: If the model does not say how well it is known.
        ValueError: If the number, the criterion or the marker is wrong.
    """
    data = columns_of(model, data)
    marker = model.markers[0] if marker is None else marker
    refuse_unknown("marker", marker, model.markers)
    recorded = data.encoders[(data.marker == marker) & (data.mirror == "")]
    if not len(recorded):
        raise DataError(f"data set {data.name!r} has no direct view of {marker!r}")
    pool = _pool(model, data, recorded, marker, rng)
    known = _rows(model, recorded, marker)
    told_already = np.eye(known.shape[2])[None]
    choice = choose_poses(
        _rows(model, pool, marker, whiten=True),
        count,
        criterion=criterion,
        targets=known,
        given=told_already,
    )
    return NextPoses(pool[choice.rows], hand_sigma(told_already, known), choice.hand_sigma, choice)


def _rows(model: SelfModel, readings: NDArray, marker: str, *, whiten: bool = False) -> NDArray:
    """Return derivatives of a marker's places by z [m], or of places of unit noise. (N, 3, p)."""
    index = np.full(len(readings), model.chain.marker_index(marker))
    parameters, covariance = model.parameters, model.covariance
    noise = noise_at(model, readings, index)
    if covariance is None or noise is None:
        raise ModelError(
            f"arm {model.name!r} does not say how well it is known: learn it by `calibrate "
            "kinematics`"
        )
    own = [i for i, name in enumerate(covariance.names) if name in parameters.names]
    columns = [parameters.names.index(covariance.names[i]) for i in own]
    _, jacobian = parameters.predict(model.servos.to_radians(readings), index)
    J = jacobian[:, :, columns] @ root_of(covariance.matrix[np.ix_(own, own)])
    return np.linalg.solve(np.linalg.cholesky(noise), J) if whiten else J


def _pool(
    model: SelfModel, data: Dataset, recorded: NDArray, marker: str, rng: np.random.Generator
) -> NDArray:
    """Draw poses between the readings that were recorded, in view of the cameras if any."""
    if data.image_size is None or not model.cameras:
        return drawn_between(recorded, POOL, rng)
    drawn = drawn_between(recorded, _DRAWS * POOL, rng)
    pixels = model.rig.project(model.predict(drawn, marker).p_WH).reshape(-1, 2, 2)
    size = np.array([camera.image_size for camera in model.rig.cameras], dtype=float)
    inside = (pixels > _MARGIN * size) & (pixels < (1.0 - _MARGIN) * size)
    seen = drawn[inside.all(axis=(1, 2))][:POOL]
    if not len(seen):
        raise DataError(
            f"none of {len(drawn)} poses between the recorded readings is in view of both cameras"
        )
    return seen
