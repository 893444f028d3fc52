"""`nico-selfmodel check`: does the body still fit, and if not, what changed."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import body_tables, console


def check(
    model: Annotated[Path, typer.Argument(help="The body: self_model.yaml, or its folder.")],
    dataset: Annotated[Path, typer.Argument(help="Folder of new sightings, in their order.")],
    relearn: Annotated[
        bool, typer.Option("--relearn", help="Learn what changed anew, and nothing else.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Result folder to make, with --relearn.")
    ] = None,
    sensor: Annotated[str, typer.Option("--sensor", help="auto, pixels or points.")] = "auto",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing folder.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Watch a body over new sightings; exit code 1 where something changed."""
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation import check_health, judge, to_json
    from nico_selfmodel.estimation.monitoring.health_document import health_document
    from nico_selfmodel.estimation.monitoring.relearning import relearn_cause, since_change
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import relearned_result
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.model import SelfModel

    if relearn != (out is not None):
        raise ValueError("--relearn and --out belong together")
    if out is not None:
        refuse_folder(out, force=force, inputs=[dataset, model])
    known, data = SelfModel.load(model), Dataset.load(dataset)
    report = check_health(known, data, sensor)
    document = health_document(report)
    if as_json:
        console.print_json(document)
    else:
        body_tables.print_health(known.name, document)
    if out is not None and not report.healthy:
        cause = report.diagnoses[0].hypothesis
        update = relearn_cause(known, data, report, sensor)
        evaluation = evaluate_update(known, update, since_change(known, data, report), sensor)
        learned = relearned_result(update, cause.cause, evaluation)
        verdict = judge(learned)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.viz.update_report import write_update_folder

        write_update_folder(
            out, evaluation, verdict, to_json(learned, verdict), report, force=force
        )
        if not as_json:
            console.print_verdict(verdict.status, verdict.reasons)
            console.print_where(out)
        raise typer.Exit(1 if verdict.status == "FAIL" else 0)
    raise typer.Exit(0 if report.healthy else 1)
