"""`nico-selfmodel evaluate`: hold a self-model against data."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nico_selfmodel.cli import options, printer

if TYPE_CHECKING:
    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.estimation.results.verdict import Verdict
    from nico_selfmodel.model.self_model import SelfModel


def evaluate(
    context: typer.Context,
    model: options.Model,
    dataset: options.Dataset,
    sensor: options.DataSensor = "auto",
    as_json: options.AsJson = False,
) -> None:
    """Print how far predictions are off on a data set.

    The error of the training stands beside it. Ends with 1 where the data contradict the model.
    """
    from nico_selfmodel.model.tree.body_model import is_body

    if is_body(model):
        options.refuse_given(context, ["sensor"], "a body is held against all that was measured")
    verdict, block = held_against(model, dataset, sensor)
    document = {"status": verdict.status, "reasons": verdict.reasons, **block}
    if as_json:
        printer.as_json(document)
    else:
        printer.errors(str(model), [(str(dataset), block)])
        printer.verdict(document)
    printer.end(document)


def held_against(
    model: Path, dataset: Path, sensor: str = "auto"
) -> "tuple[Verdict, dict[str, Any]]":
    """Return the verdict on a model by data, and the errors.

    Args:
        model: Of an arm, or a body.
        dataset: Data of the same kind.
        sensor: What an arm is judged by.
    """
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.estimation.noise.hand_observations import by_pixels
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body

    if is_body(model):
        return _of_body(model, dataset)
    learned, data = load_model(model), load_dataset(dataset)
    return (_of_pixels if by_pixels(learned, data, sensor) else _of_points)(learned, data)


def _of_body(model: Path, dataset: Path) -> "tuple[Verdict, dict[str, Any]]":
    """Return the verdict on a tree of joints by all that its sensors measured, and the errors."""
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.estimation.model_verdict import judge_body_errors
    from nico_selfmodel.estimation.monitoring.body_health import body_contradictions
    from nico_selfmodel.estimation.tree.compared_errors import (
        errors_beside_training,
        other_errors_beside_training,
    )
    from nico_selfmodel.estimation.tree.tree_errors import errors_of
    from nico_selfmodel.model.tree.body_model import load_body

    learned, data = load_body(model), load_body_dataset(dataset)
    left = errors_of(learned.tree, data)
    errors = errors_beside_training(learned, left)
    others = other_errors_beside_training(learned, left, errors)
    verdict = judge_body_errors(learned, errors, body_contradictions(learned, data), others)
    return verdict, errors.to_json() or {"n": 0}


def _of_points(learned: "SelfModel", data: "Dataset") -> "tuple[Verdict, dict[str, Any]]":
    """Return the verdict by measured points, and the errors."""
    from nico_selfmodel.estimation.arm.evaluation import evaluate as hold_against
    from nico_selfmodel.estimation.model_verdict import judge_evaluation

    evaluation = hold_against(learned, data)
    statistics = evaluation.statistics
    block = {"n": statistics.n, "position_mm": statistics.as_mm()}
    return judge_evaluation(learned, data, evaluation), block


def _of_pixels(learned: "SelfModel", data: "Dataset") -> "tuple[Verdict, dict[str, Any]]":
    """Return the verdict by what the model's cameras saw, and the errors in images and space."""
    from nico_selfmodel.errors import DataError
    from nico_selfmodel.estimation.body.body_result import pixel_errors
    from nico_selfmodel.estimation.model_verdict import judge_evaluation
    from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels

    evaluation = evaluate_pixels(learned, data)
    block = pixel_errors(evaluation).to_json()
    if block is None:
        raise DataError(
            f"self-model {learned.name!r} puts the hand out of its cameras' view wherever data set "
            f"{data.name!r} saw it: it is of another body, or of other cameras"
        )
    return judge_evaluation(learned, data, evaluation), block
