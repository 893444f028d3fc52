"""New zeros, tools and causes that were learned anew in a body of any tree, as results."""

from dataclasses import replace
from typing import Any

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, EstimationError, ModelError
from nico_selfmodel.estimation.monitoring.block_update import update_words
from nico_selfmodel.estimation.monitoring.body_relearning import BodyUpdate, relearn_body
from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.monitoring.update_result import OUTLIER_CAUSE
from nico_selfmodel.estimation.results.calibration_result import (
    FAILURE,
    CalibrationResult,
    Terms,
    findings,
)
from nico_selfmodel.estimation.tree.compared_errors import errors_of_tree
from nico_selfmodel.estimation.tree.tree_result import tree_result
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WORLD
from nico_selfmodel.names import listed


def body_update_result(update: BodyUpdate) -> CalibrationResult:
    """Return parameters that were learned anew with all that they are judged by."""
    learned, anew = tree_result(update.found), update.anew
    words = update_words(anew.misfit, anew.expected)
    broken = (
        None if update.fits else f"the rest of the body no longer fits ({_why(update, words)}): "
    )
    broken = broken and f"{broken}run `nico-selfmodel monitor` to see what changed"
    kept, was = ~update.found.solution.outliers, update.before
    before = {} if was is None else {"train": errors_of_tree(was, kept).to_json()}
    return replace(
        learned,
        method=update.method,
        findings=(*learned.findings, *findings(FAILURE, [broken])),
        seconds=update.seconds,
        details={
            **learned.details,
            "misfit": {"value": anew.misfit, "expected": anew.expected},
            "body_fits": update.fits,
            "before": before,
            **_zeros(update),
            **_tip(update),
            **({} if update.cause is None else {"cause": update.cause}),
        },
        terms=Terms(
            outlier_cause=OUTLIER_CAUSE,
            worse_cause=learned.terms.worse_cause,
            untested=f"the rest of the body fits ({words})",
        ),
    )


def left_by_cause(model: BodyModel, data: BodyDataset, report: HealthReport) -> str | None:
    """Return what the likeliest cause leaves unexplained, in words; None where it explains all."""
    if not report.diagnoses:
        return None
    try:
        update = relearn_body(model, data, report)
    except (DataError, EstimationError, ModelError) as error:
        return str(error)
    anew = update.anew
    return None if update.fits else _why(update, update_words(anew.misfit, anew.expected))


def _why(update: BodyUpdate, misfit: str) -> str:
    """Say what does not fit."""
    anew = update.anew
    if anew.read_wrongly:
        return f"readings of {listed(anew.read_wrongly)} would be wrong in many poses"
    if anew.seen_wrongly:
        return f"what was seen on {listed(anew.seen_wrongly)} contradicts it, {misfit}"
    if update.against is not None and update.against.too_many:
        return f"{update.against.words}, {misfit}"
    if anew.set_aside.any():
        outliers = f"{anew.set_aside.sum()} of {anew.set_aside.size}"
        return f"{outliers} observations contradict what was learned, {misfit}"
    return misfit


def _zeros(update: BodyUpdate) -> dict[str, Any]:
    """Return by what each zero moved, as an angle or a length of its joint."""
    if not update.joints:
        return {}
    motions = dict(zip(update.model.tree.joints, update.model.tree.motions, strict=True))
    pairs = list(zip(update.joints, update.shifts.tolist(), strict=True))
    turned = {j: float(np.degrees(s)) for j, s in pairs if motions[j] == REVOLUTE}
    shifted = {j: 1e3 * s for j, s in pairs if motions[j] != REVOLUTE}
    return {"shift_deg": turned, **({"shift_mm": shifted} if shifted else {})}


def _tip(update: BodyUpdate) -> dict[str, Any]:
    """Return how far a tip is from another point of its link, or from where it was."""
    if update.tool is None:
        return {}
    tree, anew = update.model.tree, update.anew
    tip = tree.markers[tree.marker_index(update.tool)]
    beside = [m for m in tree.markers if m.on == tip.on and m.name != tip.name]
    place, of = np.zeros(3), "the world" if tip.on == WORLD else tree.joints[tip.on]
    if beside:
        place, of = beside[0].X_LA[:3, 3], beside[0].name
    arm = tip.X_LA[:3, 3] - place
    names = anew.found.uncertainty.names
    own = [names.index(f"{tip.name}.{axis}") for axis in "xyz"]
    spread = anew.found.uncertainty.covariance[np.ix_(own, own)]
    reach = float(np.linalg.norm(arm))
    direction = arm / reach if reach else np.full(3, 3**-0.5)
    sigma = float(np.sqrt(direction @ spread @ direction))
    return {
        "tool": tip.name,
        "known": update.before is not None,
        "reach_mm": {"value": 1e3 * reach, "sigma": 1e3 * sigma, "from": of},
    }
