"""Learning anew what changed in a body of any tree, and nothing else."""

from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration, refit_tree
from nico_selfmodel.estimation.tree.tree_errors import told_as
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel


def relearn_body(
    model: BodyModel, data: BodyDataset, report: HealthReport
) -> tuple[TreeCalibration, BodyModel]:
    """Learn the likeliest cause anew from the poses since the change.

    Args:
        model: The body as it was.
        data: The recording in which it changed.
        report: What `check_body_health` says of it.

    Returns:
        What was learned, and the body with it; what else is known of it stays as it was.

    Raises:
        DataError: If too little was seen since.
        ValueError: If the body is healthy.
    """
    if report.changed_at is None or not report.diagnoses:
        raise ValueError("nothing changed: there is nothing to learn anew")
    since = np.isin(data.sample, report.sample[report.changed_at :])
    names = report.diagnoses[0].hypothesis.names
    world = str(model.provenance.get("world", "world"))
    seen = told_as(model.tree, data.select(since))
    found = refit_tree(model.tree, seen, names, world=world, name=model.name)
    return found, replace(model, tree=found.tree, covariance=_known_since(model, found))


def _known_since(model: BodyModel, found: TreeCalibration) -> ParameterCovariance | None:
    """Return the covariance of before, with that of what was learned anew in its place."""
    if model.covariance is None:
        return None
    new = found.uncertainty
    kept = [i for i, name in enumerate(model.covariance.names) if name not in new.names]
    n, k = len(kept), len(new.names)
    matrix = np.zeros((n + k, n + k))
    matrix[:n, :n] = model.covariance.matrix[np.ix_(kept, kept)]
    matrix[n:, n:] = new.covariance
    names = tuple(model.covariance.names[i] for i in kept)
    return ParameterCovariance((*names, *new.names), matrix)
