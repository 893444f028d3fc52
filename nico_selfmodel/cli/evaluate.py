"""`nico-selfmodel evaluate`: hold a self-model against data."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console


def evaluate(
    model: Annotated[Path, typer.Argument(help="self_model.yaml, or a result folder.")],
    dataset: Annotated[Path, typer.Argument(help="Folder of the data set.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Print the error of a self-model's predictions on a data set, beside that of its training."""
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation import evaluate as hold_against
    from nico_selfmodel.estimation import judge_evaluation
    from nico_selfmodel.model import SelfModel

    learned = SelfModel.load(model)
    evaluation = hold_against(learned, Dataset.load(dataset))
    verdict, statistics = judge_evaluation(learned, evaluation), evaluation.statistics
    block = {"n": statistics.n, "position_mm": statistics.as_mm()}
    if as_json:
        console.print_json({"status": verdict.status, "reasons": verdict.reasons, **block})
    else:
        row = console.statistics_row(str(dataset), block)
        console.print_table(f"{model}", console.STATISTICS_HEADINGS, [row])
        console.print_verdict(verdict.status, verdict.reasons)
    raise typer.Exit(1 if verdict.status == "FAIL" else 0)
