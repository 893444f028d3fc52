"""Which poses to record next: those that tell a learned arm most beyond what it was learned from.

The poses that were recorded say three things: how far each joint is known to go, what is told
already, and where the hand must be predicted well.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.observations.pixel_observations import columns_of
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.planning.pose_selection import (
    NextPoses,
    bending_priors,
    choose_poses,
    drawn_between,
    hand_sigma,
    position_jacobians,
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

    The hand's error is in metres; it is nan where the model's noise is not known.

    That a body does not collide in a pose is not known here: only the ranges of single joints are.

    Args:
        model: What was learned from the data.
        data: What was recorded.
        count: How many poses to choose.
        rng: Source of the pool.
        criterion: `I` for the prediction of the hand, `D` for all parameters.
        marker: Tracked point; the first of the model by default.

    Raises:
        DataError: If the data are of other joints, units or images, or no pose is in view.
        NotIdentifiableError: If recorded and chosen poses do not determine the parameters.
        ValueError: If the number, the criterion or the marker is wrong.
    """
    data = columns_of(model, data)
    marker = model.markers[0] if marker is None else marker
    refuse_unknown("marker", marker, model.markers)
    recorded = data.encoders[(data.marker == marker) & (data.mirror == "")]
    if not len(recorded):
        raise DataError(f"data set {data.name!r} has no direct view of {marker!r}")
    known = position_jacobians(model, recorded, marker)
    pool = _pool(model, data, recorded, marker, rng)
    told = np.concatenate([known, bending_priors(model, marker)])
    choice = choose_poses(
        position_jacobians(model, pool, marker),
        count,
        criterion=criterion,
        targets=known,
        given=told,
    )
    noise = np.nan if model.noise_sigma is None else model.noise_sigma
    return NextPoses(
        pool[choice.rows], noise * hand_sigma(told, known), noise * choice.hand_sigma, choice
    )


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
