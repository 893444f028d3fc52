"""The part of `nico-selfmodel learn` that goes through the eyes."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from nico_selfmodel.experiments.body_lesson import BodyScenario
    from nico_selfmodel.systems import Imperfections

THESIS = {
    "stereo-fiducial": ("thesis, refined (real robot)", ("1.99", "1.24"), (2.61, 1.71)),
    "stereo-color": ("thesis, kinematics by sight (real robot)", ("3.77", "2.30"), (5.78, 4.50)),
}
"""Sensor -> what the thesis reports in chapter 8, by colour in chapter 7: mm and px, mean, SD."""


def learn_by_sight(
    out: Path,
    sensor: str,
    world: "Imperfections",
    seed: int,
    random_poses: int,
    force: bool,
    as_json: bool,
    mirror: bool = False,
) -> None:
    """Calibrate the eyes, watch the hand, learn the arm, refine both, write the result folder."""
    from nico_selfmodel.cli.learn_mirror import print_mirror_scenario, write_mirror_scenario
    from nico_selfmodel.experiments.body_lesson import learn_body
    from nico_selfmodel.experiments.eyes_lesson import MARKERS, Counts

    marker = MARKERS[sensor]
    with console.progress_bar() as stage:
        scenario = learn_body(
            world, seed, marker=marker, counts=Counts(random=random_poses), stage=stage
        )
        seen = None
        if mirror:
            from nico_selfmodel.experiments.mirror_lesson import learn_mirror, with_mirror

            familiar = scenario.arm.train.encoders
            seen = learn_mirror(
                scenario.model, world, seed, marker=marker, familiar=familiar, stage=stage
            )
            scenario = with_mirror(scenario, seen)
        stage("writing the result", 0, 1)
        document = write_scenario(out, scenario, marker, force)
        if seen is not None:
            document = write_mirror_scenario(out, document, seen)
        stage("writing the result", 1, 1)
    if as_json:
        console.print_json(document)
    else:
        if seen is not None:
            print_mirror_scenario(document)
        _print(scenario, document, sensor, out)
    raise typer.Exit(1 if document["status"] == "FAIL" else 0)


def write_scenario(out: Path, scenario: "BodyScenario", marker: str, force: bool) -> dict[str, Any]:
    """Write the refined body, or the arm as it was before where the refinement was refused.

    Args:
        out: The folder to make.
        scenario: What was learned.
        marker: What was tracked.
        force: Replace an existing folder.

    Returns:
        What is in its `result.json`.
    """
    from nico_selfmodel.estimation import to_json
    from nico_selfmodel.systems import looking_arm
    from nico_selfmodel.viz.body_report import write_body_folder

    if scenario.refined is None or not scenario.accepted:
        return _write_unrefined(out, scenario, marker, force)
    document = to_json(scenario.refined, scenario.verdict) | _told(scenario)
    write_body_folder(
        out,
        scenario.refined,
        scenario.verdict,
        document,
        robot=looking_arm(marker),
        recordings={"train": scenario.arm.train, "test": scenario.arm.test},
        force=force,
    )
    return document


def _write_unrefined(
    out: Path, scenario: "BodyScenario", marker: str, force: bool
) -> dict[str, Any]:
    """Write the arm as it was learned after the eyes, and why nothing better came of it."""
    from nico_selfmodel.estimation import judge, result_of, to_json
    from nico_selfmodel.plant import learned_urdf
    from nico_selfmodel.systems import looking_arm
    from nico_selfmodel.viz import write_result_folder

    arm, robot = scenario.arm, looking_arm(marker)
    result = arm.sight.with_pixels(result_of(arm.calibration), arm.model)
    verdict = judge(result)
    document = to_json(result, verdict) | _told(scenario)
    write_result_folder(
        out,
        arm.calibration,
        verdict,
        document,
        urdf_text=learned_urdf(arm.model, robot, folder=out),
        robot_name="nico",
        robot=robot,
        recordings={"train": arm.train, "test": arm.test},
        force=force,
    )
    return document


def _told(scenario: "BodyScenario") -> dict[str, Any]:
    """Return what `result.json` tells of the eyes, and of the refinement."""
    from nico_selfmodel.estimation.body.body_result import refinement_block

    eyes = scenario.eyes
    return {
        "refinement": refinement_block(scenario.arm.seen, scenario.refined, scenario.verdict),
        "eyes": {
            "boards": len(eyes.views),
            "rms_px": eyes.eyes.rms,
            "baseline_mm": 1e3 * scenario.model.rig.baseline,
        },
    }


def _print(scenario: "BodyScenario", document: Mapping[str, Any], sensor: str, out: Path) -> None:
    label, mm, px = THESIS[sensor]
    refinement = document["refinement"]
    before, after = refinement["before"], refinement["after"]
    kept = "held out, arm and eyes refined" + ("" if scenario.accepted else " (refused)")
    console.print_table(
        f"{scenario.model.name}: error of the predicted hand position",
        console.STATISTICS_HEADINGS,
        [
            console.statistics_row("held out, arm learned after the eyes", before),
            console.statistics_row(kept, after),
            console.statistics_row("training", document["train"]),
            [label, "100", *mm, "-", "-", "-"],
        ],
    )
    console.out.print(
        f"in the images: {_px(before)} before, {_px(after)} after (thesis {px[0]:.2f}, SD "
        f"{px[1]:.2f}); eyes learned from {document['eyes']['boards']} boards to "
        f"{document['eyes']['rms_px']:.2f} px"
    )
    boards = refinement["boards"]
    if boards is not None and boards["after"] is not None:
        edges = [boards[k]["edge_mm"]["sd"] for k in ("before", "after")]
        scale = [100.0 * (boards[k]["scale"]["mean"] - 1.0) for k in ("before", "after")]
        console.out.print(
            f"{boards['after']['boards']} held-out boards: SD of edges {edges[0]:.3f} -> "
            f"{edges[1]:.3f} mm, scale {scale[0]:+.3f} -> {scale[1]:+.3f} %"
        )
    if scenario.accepted:
        mechanics = document["workspace"]["mechanics_mm"]["mean"]
        console.out.print(
            f"the play of the joints alone leaves {mechanics:.2f} mm (rms), more data would cure "
            f"{document['workspace']['learned_mm']['mean']:.2f} mm"
        )
    for reason in refinement["reasons"]:
        console.out.print(f"refinement refused, the arm before it is kept: {reason}", markup=False)
    console.print_outliers(document)
    console.print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    console.print_where(out)


def _px(block: Mapping[str, Any] | None) -> str:
    if block is None:
        return "-"
    return f"{block['pixels']['mean']:.2f} px (SD {block['pixels']['sd']:.2f})"
