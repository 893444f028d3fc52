"""The part of `nico-selfmodel learn` that goes through the eyes."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from nico_selfmodel.experiments.eyes_lesson import ArmLesson, EyesLesson
    from nico_selfmodel.systems import World


def learn_by_sight(
    out: Path,
    sensor: str,
    world: "World",
    seed: int,
    random_poses: int,
    force: bool,
    as_json: bool,
) -> None:
    """Calibrate the eyes, watch the hand, learn the arm, and write the result folder."""
    from nico_selfmodel.experiments.eyes_lesson import (
        MARKERS,
        Counts,
        learn_through_the_eyes,
    )

    marker = MARKERS[sensor]
    with console.progress_bar() as stage:
        lesson = learn_through_the_eyes(
            world, seed, markers=(marker,), counts=Counts(random=random_poses), stage=stage
        )
        stage("writing the result", 0, 1)
        document = _write(out, lesson, marker, force)
        stage("writing the result", 1, 1)
    if as_json:
        console.print_json(document)
    else:
        _print(lesson.arms[marker], document, sensor, out)
    raise typer.Exit(1 if document["status"] == "FAIL" else 0)


def _write(out: Path, lesson: "EyesLesson", marker: str, force: bool) -> dict[str, Any]:
    """Write the result folder; return what is in its `result.json`."""
    from nico_selfmodel.estimation import judge, result_document
    from nico_selfmodel.plant import learned_urdf
    from nico_selfmodel.systems import looking_arm
    from nico_selfmodel.viz import write_result_folder

    arm = lesson.arms[marker]
    verdict = judge(arm.calibration)
    robot = looking_arm(marker)
    write_result_folder(
        out,
        arm.calibration,
        verdict,
        urdf_text=learned_urdf(arm.model, robot, folder=out),
        robot_name="nico",
        robot=robot,
        recordings={"train": arm.train, "test": arm.test},
        force=force,
    )
    document = result_document(arm.calibration, verdict)
    arm.sight.add_pixels(document, arm.model)
    document["eyes"] = {
        "boards": len(lesson.views),
        "rms_px": lesson.eyes.rms,
        "baseline_mm": 1e3 * lesson.eyes.rig.baseline,
    }
    console.write_document(out, document)
    return document


def _print(arm: "ArmLesson", document: dict[str, Any], sensor: str, out: Path) -> None:
    thesis = {"stereo-fiducial": ("2.74", "1.39"), "stereo-color": ("3.77", "2.30")}[sensor]
    console.print_table(
        f"{arm.model.name}: error of the predicted hand position",
        console.STATISTICS_HEADINGS,
        [
            console.statistics_row("held out", document["test"]),
            console.statistics_row("training", document["train"]),
            ["thesis, kinematics by sight (real robot)", "100", *thesis, "-", "-", "-"],
        ],
    )
    seen = document["test"].get("pixels")
    if seen:
        console.out.print(
            f"in the images: {seen['mean']:.2f} px (SD {seen['sd']:.2f}) on new poses; eyes "
            f"learned from {document['eyes']['boards']} boards to "
            f"{document['eyes']['rms_px']:.2f} px"
        )
    console.print_outliers(document)
    console.print_verdict(document["status"], document["reasons"])
    console.print_where(out)
