"""`nico-selfmodel calibrate kinematics` over many recordings: a result for each, and one table."""

import json
import os
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.calibrate.arm_task import ArmTask
from nico_selfmodel.cli.result_files import stamped
from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.files.csv_cells import rows_text
from nico_selfmodel.files.whole import RESULT_FILE, folder_written_whole
from nico_selfmodel.parallel import Workers
from nico_selfmodel.progress import telling_nobody

TABLE_FILE = "table.csv"
_HEADINGS = ("data set", "verdict", "poses", "held out [mm]", "training [mm]", "outliers")
_COLUMNS = ("dataset", "verdict", "poses", "held_out_mean_mm", "training_mean_mm", "outliers")
_REFUSED = "REFUSED"
"""In place of a verdict: the data set could not be learned from."""


@dataclass(frozen=True)
class Recording:
    """One of many data sets."""

    name: str
    """Its path below what all have in common: also that of its result."""
    dataset: Path


def recordings_in(folders: Sequence[Path]) -> list[Recording]:
    """Return the data sets that folders are, or hold, each named by what tells it from the others.

    Args:
        folders: Data sets, and folders that hold some, at any depth.

    Raises:
        ValueError: If there is none in a folder, or a folder is given twice.
    """
    found: list[Path] = []
    real = [path.resolve() for path in folders]
    for k, path in enumerate(folders):
        if real[k] in real[:k]:
            raise ValueError(f"{path} is given twice: leave one of them out")
    for folder in folders:
        inside = sorted(path.parent for path in folder.rglob("samples.csv"))
        if not inside:
            raise ValueError(f"{folder} holds no data set (samples.csv)")
        found += inside
    places = list(dict.fromkeys(path.absolute() for path in found))
    common = Path(os.path.commonpath(places)) if len(places) > 1 else places[0].parent
    return [Recording(str(place.relative_to(common)), place) for place in places]


def calibrate_many(recordings: Sequence[Recording], task: ArmTask, workers: Workers) -> NoReturn:
    """Learn from each recording; write a result for each, `table.csv` and `result.json`.

    Args:
        task: How, and the folder to make, whole or not at all.

    Raises:
        typer.Exit: Always, with 1 where one of them failed or was refused.
    """
    out = task.output.out
    with (
        folder_written_whole(out, force=task.output.force) as inside,
        printer.progress_bar() as progress,
    ):
        found = workers.map(
            partial(_learn, task, inside.absolute()),
            recordings,
            lambda done, total: progress(f"learning from {total} recordings", done, total),
        )
        document = stamped(_document(found))
        text = json.dumps(document, indent=1, allow_nan=False) + "\n"
        (inside / RESULT_FILE).write_text(text, encoding="utf-8")
        columns = (*_COLUMNS, "reason")
        rows = ([row[column] for column in columns] for row in found)
        (inside / TABLE_FILE).write_text(rows_text(columns, rows), encoding="utf-8")
    if task.output.as_json:
        printer.as_json(document)
    else:
        rows = [[_shown(row[column]) for column in _COLUMNS] for row in found]
        printer.table(f"{len(found)} recordings", _HEADINGS, rows)
        printer.verdict(document)
        printer.line(f"\nresult   {out}/: {TABLE_FILE}, {RESULT_FILE} and one folder for each")
    printer.end(document)


def _learn(task: ArmTask, out: Path, recording: Recording) -> dict[str, Any]:
    """Learn from one recording, wherever this runs; return its row of the table."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is doubtful stands in each report
        try:
            output = replace(task.output, out=out / recording.name, force=False)
            _, document = task.run(recording.dataset, output, telling_nobody)
        except (SelfModelError, ValueError, OSError) as error:
            empty = dict.fromkeys(_COLUMNS)
            reason = " ".join(str(error).split())
            return empty | {"dataset": recording.name, "verdict": _REFUSED, "reason": reason}
    return {
        "dataset": recording.name,
        "verdict": document["status"],
        "poses": (document["test"] or {}).get("poses", (document["test"] or {}).get("n")),
        "held_out_mean_mm": _mean(document["test"]),
        "training_mean_mm": _mean(document["train"]),
        "outliers": len(document["outliers"]),
        "reason": document["reasons"][0] if document["reasons"] else "",
    }


def _mean(block: Mapping[str, Any] | None) -> float | None:
    found = (block or {}).get("position_mm")
    return None if found is None else found["mean"]


def _document(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the table as plain data, with a verdict: the worst of all."""
    counts = Counter(row["verdict"] for row in rows)
    bad = [row for row in rows if row["verdict"] in ("FAIL", _REFUSED)]
    short = counts["NOT_EVALUATED"] > 0
    reasons = [f"{row['dataset']}: {row['verdict']}: {row['reason']}" for row in bad]
    told = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    return {
        "status": "FAIL" if bad else "NOT_EVALUATED" if short else "PASS",
        "reasons": [f"of {len(rows)} recordings: {told}", *reasons],
        "warnings": [],
        "recordings": [dict(row) for row in rows],
    }


def _shown(value: Any) -> str:
    return "-" if value is None else f"{value:#.3g}" if isinstance(value, float) else str(value)
