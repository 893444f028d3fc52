"""`nico-selfmodel monitor`: does the body still fit, and if not, what changed."""

import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.calibrate import any_body
from nico_selfmodel.cli.option_groups import Output
from nico_selfmodel.cli.result_files import judge_and_write


def monitor(
    context: typer.Context,
    model: options.Model,
    dataset: options.Dataset,
    relearn: Annotated[
        bool, typer.Option("--relearn", help="Learn what changed anew, and nothing else.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder to make, with --relearn.")
    ] = None,
    sensor: options.DataSensor = "auto",
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Say whether the body is still what it was, and what changed.

    Observations count in their order. Ends with 1 where something changed.
    """
    from nico_selfmodel.model.tree.body_model import is_body

    if is_body(model):
        _check_relearn(model, dataset, out, relearn=relearn, force=force)
        options.refuse_given(context, ["sensor"], "a body is watched by all that saw it")
        _monitor_body(model, dataset, out, force=force, as_json=as_json)
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.estimation.monitoring.health import check_health
    from nico_selfmodel.estimation.monitoring.health_document import health_document
    from nico_selfmodel.estimation.monitoring.relearning import (
        left_by_cause,
        relearn_cause,
        since_change,
    )
    from nico_selfmodel.estimation.monitoring.update_evaluation import evaluate_update
    from nico_selfmodel.estimation.monitoring.update_result import relearned_result
    from nico_selfmodel.model.self_model_file import load_model

    _check_relearn(model, dataset, out, relearn=relearn, force=force)
    known, data = load_model(model), load_dataset(dataset)
    report = check_health(known, data, sensor)
    document = health_document(report, left_by_cause(known, data, report, sensor))
    whole = report.changed_at == 0
    out = _tell(known.name, document, model, dataset, out, whole=whole, as_json=as_json)
    cause = report.diagnoses[0].hypothesis
    update = relearn_cause(known, data, report, sensor)
    evaluation = evaluate_update(known, update, since_change(known, data, report), sensor)
    learned = relearned_result(update, cause.cause, evaluation)
    from nico_selfmodel.viz.reports.updates import update_report  # slow to load

    draw = partial(update_report, evaluation, health=report)
    relearned = judge_and_write(learned, evaluation.after, draw, Output(out, force))
    _end(known.name, relearned, out, as_json=as_json)


def _check_relearn(
    model: Path, dataset: Path, out: Path | None, *, relearn: bool, force: bool
) -> None:
    """Refuse --relearn without --out, --out without --relearn, and a folder that is there."""
    from nico_selfmodel.files.whole import refuse_folder

    if relearn != (out is not None):
        raise ValueError("--relearn and --out belong together")
    if out is not None:
        refuse_folder(out, force=force, inputs=[dataset, model])


def _monitor_body(
    model: Path, dataset: Path, out: Path | None, *, force: bool, as_json: bool
) -> NoReturn:
    """Hold a body of any tree against a recording of it; learn what changed where `out` is."""
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.estimation.monitoring.body_health import check_body_health
    from nico_selfmodel.estimation.monitoring.body_relearning import relearn_body
    from nico_selfmodel.estimation.monitoring.body_update_result import left_by_cause
    from nico_selfmodel.estimation.monitoring.health_document import health_document
    from nico_selfmodel.model.tree.body_model import load_body

    known, data = load_body(model), load_body_dataset(dataset)
    report = check_body_health(known, data)
    left = left_by_cause(known, data, report)
    document, whole = health_document(report, left), report.changed_at == 0
    out = _tell(known.name, document, model, dataset, out, whole=whole, as_json=as_json)
    relearned = any_body.write_update(relearn_body(known, data, report), Output(out, force))
    _end(known.name, relearned, out, as_json=as_json)


def _end(name: str, relearned: dict[str, Any], out: Path, *, as_json: bool) -> NoReturn:
    """Print what was learned anew, but beside a report that was printed as a document."""
    if not as_json:
        printer.result(name, relearned, Output(out))
    printer.end(relearned)


def _tell(
    name: str,
    document: dict[str, Any],
    model: Path,
    dataset: Path,
    out: Path | None,
    *,
    whole: bool,
    as_json: bool,
) -> Path:
    """Print what a health report says, with the command that learns each cause anew.

    A cause that leaves a misfit is no cure: no command is told then.

    Returns:
        Where what changed shall be written; where nothing shall be, the command ends.
    """
    for cause in document["causes"] if document["explained"] else ():
        cause["command"] = remedy(cause["parameters"], model, dataset, whole=whole)
    if as_json:
        printer.as_json(document)
    else:
        _print(name, document)
    if out is None or not document["causes"]:
        printer.end(document)
    return out


def remedy(parameters: Sequence[str], model: Path, dataset: Path, *, whole: bool = True) -> str:
    """Return the command that learns anew what changed, and nothing else.

    Args:
        parameters: What changed.
        model: The body as it was.
        dataset: The recording in which it changed.
        whole: Whether it had changed before the first pose. Where it changed later only `--relearn`
            leaves out what was seen before.
    """
    owners = {name.rpartition(".")[0] for name in parameters}
    owner = owners.pop() if len(owners) == 1 else ""
    words = ["monitor", model, dataset, "--relearn"]
    if whole and list(parameters) == [f"{owner}.theta_offset"]:
        words = ["rezero", model, dataset, "--joint", owner]
    elif whole and owner.startswith("hand."):
        marker = owner.removeprefix("hand.")
        words = ["calibrate", "tool", dataset, "--model", model, "--tool", marker]
    return shlex.join(
        map(str, ["nico-selfmodel", *words, "--out", inputs.beside(dataset, "relearned")])
    )


def _print(name: str, document: Mapping[str, Any]) -> None:
    found, against, misfit = (document[key] for key in ("log_ratio", "contradicting", "misfit"))
    off = [f"{misfit[key]:.2f}" for key in ("per_coordinate", "most")]
    rows = [
        ["innovation squared, a coordinate (about 1)", f"{document['nis_per_coordinate']:.2f}", ""],
        ["poses that contradict", f"{len(against['samples'])}", f"{against['most']}"],
        ["all others, together", *off],
        ["ln R (Shiryaev, Roberts)", f"{found['largest']:.1f}", f"{found['threshold']:.0f}"],
    ]
    printer.table(f"{name}: {document['poses']} poses", ("", "found", "limit"), rows)
    causes = document["causes"]
    if causes:
        keys = ("statistic", "dof", "score")
        rows = [[c["cause"], *(f"{c[key]:.1f}".removesuffix(".0") for key in keys)] for c in causes]
        printer.table("what may have changed", ("cause", "ratio", "dof", "score"), rows)
    printer.verdict(document)
    if causes and "command" in causes[0]:
        printer.line(f"learn just that: {causes[0]['command']}")
