"""The report on how servos follow their commands."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from nico_selfmodel.estimation.response.servo_calibration import (
    JointResponse,
    ServoCalibration,
    residuals_of,
)
from nico_selfmodel.files.csv_cells import rows_text
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.over_time.response_plot import commands_plot, response_plot
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.page import Key, Report, key_number
from nico_selfmodel.viz.reports.parameter_tables import ParameterTables
from nico_selfmodel.viz.reports.tables import Cell, Table, error_table, held_out, number_cell

_PARTS = (
    ("delay", "delay [ms]"),
    ("speed", "speed [deg/s]"),
    ("acceleration", "accel. [deg/s²]"),
    ("rate", "rate [1/s]"),
)
_WHAT = (
    "A command takes the delay to show. Then a `profile` goes at most at its speed and changes it "
    "by its acceleration, and the joint follows that with a lag of 1 / rate; a `loop` goes at its "
    "speed until its rate times what is left is less. +- is one standard deviation."
)


def servo_report(calibration: ServoCalibration, document: Mapping[str, Any]) -> Report:
    """Return how the servos of a robot follow their commands.

    Args:
        document: `estimation.judging.to_json` of it; the numbers shown are these.
    """
    joints = calibration.joints
    if joints:
        key = key_number(document, "angle_deg", "readings", statistics=("rms", "median"))
        about = "Steps of each joint, as read and as expected"
        picture = parts.Drawing(response_plot(joints), about)
        sections = (_errors(calibration, document), _evidence(joints, document))
    else:
        key = Key("none", "joint follows its commands", "")
        about = "Commands and readings over time"
        picture, sections = parts.Drawing(commands_plot(calibration.train), about), ()
    provenance = {
        "learned from": f"{calibration.train.name}, {len(calibration.train)} rows, sha256 "
        f"{calibration.train.content_hash}"
    }
    return Report(
        calibration.model.name,
        "How servos follow their commands: delay, speed, acceleration, rate",
        document,
        key,
        (*sections, shared_sections.provenance_section(document, provenance)),
        picture,
        (parts.numbers(_learned(document), "cards"), parts.hint(_WHAT)) if joints else (),
        _residuals(joints) if joints else "",
    )


def _learned(document: Mapping[str, Any]) -> Table:
    known = ParameterTables(document["parameters"])
    rows = []
    for joint, found in document["responses"].items():
        cells = [Cell(found["kind"])]
        for part, _ in _PARTS:
            entry = known.entries.get(f"{joint}.{part}")
            if entry is not None and entry["value"] is None:
                cells.append(Cell("not reached" if part == "speed" else "too fast to show"))
            else:
                cells.append(known.cell(f"{joint}.{part}"))
        rows.append((joint, tuple(cells)))
    return Table(("joint", "kind", *(heading for _, heading in _PARTS)), tuple(rows))


def _errors(calibration: ServoCalibration, document: Mapping[str, Any]) -> parts.Section:
    crossed = np.concatenate([joint.left_out for joint in calibration.joints])
    test = calibration.test
    sets = error_sets(
        None if not test else np.degrees(np.abs(np.concatenate([r for _, r in test]))),
        np.degrees(np.abs(crossed[np.isfinite(crossed)])),
        np.degrees(np.abs(np.concatenate([joint.fitted for joint in calibration.joints]))),
    )
    figure = distribution(sets, unit="deg", what="angle off", thing="reading")
    table = error_table(held_out(document, "angle_deg"), "angle [deg]", 3, "n")
    words = (
        "How far each reading is from where it is expected, all steps of a joint with one delay."
    )
    return shared_sections.errors_section(
        document,
        (table, words),
        few="of so few steps",
        figure=parts.Drawing(figure, "Distribution of the errors", "half"),
    )


def _evidence(joints: tuple[JointResponse, ...], document: Mapping[str, Any]) -> parts.Section:
    headings = (
        *("joint", "steps", "not used", "outliers", "delays scatter by [ms]"),
        *("unexplained [% of the way]", "goes too far [%]", "rests off by [deg]"),
    )
    rows = []
    for joint in joints:
        found = document["responses"][joint.steps.joint]
        cells = (
            number_cell(found["steps"]),
            number_cell(found["unused_steps"]),
            number_cell(int(joint.outliers.sum())),
            number_cell(1e3 * found["delay_spread_s"], 1),
            number_cell(100.0 * found["unexplained"], 2),
            number_cell(100.0 * max(found["overshoot"], 0.0), 1),
            number_cell(found["rests_off_deg"], 3),
        )
        rows.append((joint.steps.joint, cells))
    return parts.section(
        "What each joint's steps tell",
        parts.numbers(Table(headings, tuple(rows)), "cards"),
        parts.hint(
            "A delay scatters where a command waits for the bus, or times are of another clock. "
            "Standard deviations are those of a jackknife over steps, so that they hold what "
            "differs from step to step."
        ),
        id="steps",
    )


def _residuals(joints: tuple[JointResponse, ...]) -> str:
    headings = ("joint", "step", "outlier", "time_s", "gone_rad", "expected_rad", "error_deg")
    rows = []
    for joint in joints:
        steps = joint.steps
        off = residuals_of(steps, joint.response)
        values = zip(
            *(steps.step.tolist(), steps.time.tolist(), steps.gone.tolist(), off.tolist()),
            strict=True,
        )
        for step, time, gone, error in values:
            outlier = "yes" if joint.outliers[step] else "no"
            expected = gone - error
            told = (step, outlier, time, gone, expected, float(np.degrees(error)))
            rows.append((steps.joint, *told))
    return rows_text(headings, rows)
