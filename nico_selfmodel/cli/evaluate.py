"""`nico-selfmodel evaluate`: hold a self-model against data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import body_tables, console

if TYPE_CHECKING:
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation import Verdict
    from nico_selfmodel.model import SelfModel


def evaluate(
    model: Annotated[Path, typer.Argument(help="self_model.yaml, or a result folder.")],
    dataset: Annotated[Path, typer.Argument(help="Folder of the data set.")],
    sensor: Annotated[str, typer.Option("--sensor", help="auto, pixels or points.")] = "auto",
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Print the error of a self-model's predictions on a data set, beside that of its training."""
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation.noise.hand_observations import by_pixels
    from nico_selfmodel.model import SelfModel

    learned, data = SelfModel.load(model), Dataset.load(dataset)
    seen = by_pixels(learned, data, sensor)
    verdict, block = (_of_pixels if seen else _of_points)(learned, data)
    if as_json:
        console.print_json({"status": verdict.status, "reasons": verdict.reasons, **block})
    else:
        if seen:
            body_tables.print_sight(f"{model}", str(dataset), block)
        else:
            row = console.statistics_row(str(dataset), block)
            console.print_table(f"{model}", console.STATISTICS_HEADINGS, [row])
        console.print_verdict(verdict.status, verdict.reasons)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)


def _of_points(learned: "SelfModel", data: "Dataset") -> "tuple[Verdict, dict[str, Any]]":
    """Return the verdict by measured points, and the errors."""
    from nico_selfmodel.estimation import evaluate as hold_against
    from nico_selfmodel.estimation import judge_evaluation

    evaluation = hold_against(learned, data)
    statistics = evaluation.statistics
    block = {"n": statistics.n, "position_mm": statistics.as_mm()}
    return judge_evaluation(learned, data, evaluation), block


def _of_pixels(learned: "SelfModel", data: "Dataset") -> "tuple[Verdict, dict[str, Any]]":
    """Return the verdict by what the model's eyes saw, and the errors in images and space."""
    from nico_selfmodel.errors import DataError
    from nico_selfmodel.estimation import evaluate_pixels, judge_evaluation
    from nico_selfmodel.estimation.body.body_result import pixel_errors

    evaluation = evaluate_pixels(learned, data)
    block = pixel_errors(evaluation).to_json()
    if block is None:
        raise DataError(
            f"self-model {learned.name!r} puts the hand out of its eyes' view wherever data set "
            f"{data.name!r} saw it: it is of another body, or of other eyes"
        )
    return judge_evaluation(learned, data, evaluation), block
