"""Learning just what changed."""

import numpy as np

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.block_update import BlockUpdate, learn_block
from nico_selfmodel.estimation.health import HealthReport
from nico_selfmodel.estimation.pixel_observations import columns_of
from nico_selfmodel.estimation.sightings import sightings_of
from nico_selfmodel.model.self_model import SelfModel


def relearn_cause(
    model: SelfModel, dataset: Dataset, report: HealthReport, sensor: str = "auto"
) -> BlockUpdate:
    """Learn the parameters anew that a health report blames, from the sightings since.

    Args:
        model: The body as it was.
        dataset: The data that were checked.
        report: What was found in them.
        sensor: As they were checked.

    Returns:
        The body with just that learned.

    Raises:
        EstimationError: If the body is healthy.
        NotIdentifiableError: If the sightings since the change are too few.
    """
    if report.changed_at is None:
        raise EstimationError("the body fits what is known of it: there is nothing to learn anew")
    since = columns_of(model, dataset)
    since = since.select(np.isin(since.sample, report.sample[report.changed_at :]))
    sightings = sightings_of(model, since, sensor)
    names = report.diagnoses[0].hypothesis.names
    return learn_block(model, sightings, names, scales=_scales(model, names))


def _scales(model: SelfModel, names: tuple[str, ...]) -> np.ndarray:
    """Return the natural scale of each parameter: one radian, the arm's length, the gear."""
    chain = model.chain
    size = float(np.linalg.norm(chain.p_WH_zero[0] - chain.points, axis=1).max())
    gears = dict(zip(model.joints, model.servos.gear.tolist(), strict=True))
    scales = []
    for name in names:
        joint, _, part = name.rpartition(".")
        if part == "gear":
            scales.append(gears[joint])
        else:
            scales.append(1.0 if part in ("theta_offset", "rx", "ry", "rz", "alpha") else size)
    return np.array(scales)
