"""Learning just what changed."""

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.monitoring.block_update import BlockUpdate, learn_block
from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.noise.hand_observations import hand_observations_of
from nico_selfmodel.estimation.observations.parameter_scales import parameter_scales_of
from nico_selfmodel.estimation.observations.pixel_observations import columns_of
from nico_selfmodel.model.self_model import SelfModel


def relearn_cause(
    model: SelfModel, dataset: Dataset, report: HealthReport, sensor: str = "auto"
) -> BlockUpdate:
    """Learn the parameters anew that a health report blames, from the observations since.

    Raises:
        EstimationError: If the body is healthy.
        NotIdentifiableError: If the observations since the change are too few.
    """
    if report.changed_at is None:
        raise EstimationError("the body fits what is known of it: there is nothing to learn anew")
    observations = hand_observations_of(model, since_change(model, dataset, report), sensor)
    names = report.diagnoses[0].hypothesis.names
    return learn_block(model, observations, names, scales=parameter_scales_of(model, names))


def left_by_cause(
    model: SelfModel, dataset: Dataset, report: HealthReport, sensor: str = "auto"
) -> str | None:
    """Return what the likeliest cause leaves unexplained, in words; None where it explains all."""
    if not report.diagnoses:
        return None
    try:
        update = relearn_cause(model, dataset, report, sensor)
    except (EstimationError, ModelError) as error:
        return str(error)
    return None if update.fits else update.misfit_words


def since_change(model: SelfModel, dataset: Dataset, report: HealthReport) -> Dataset:
    """Return the data since a body changed.

    Args:
        model: The body as it was.
        dataset: The data that were checked.
        report: What was found in them; the body is not healthy.
    """
    since = columns_of(model, dataset)
    return since.select(np.isin(since.sample, report.sample[report.changed_at :]))
