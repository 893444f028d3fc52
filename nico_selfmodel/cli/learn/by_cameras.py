"""The part of `nico-selfmodel learn` that goes through the robot's cameras."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.option_groups import Output
from nico_selfmodel.cli.result_files import judge_and_write
from nico_selfmodel.progress import Progress, telling_nobody

if TYPE_CHECKING:
    from nico_selfmodel.sessions.body_scenario import BodyScenario
    from nico_selfmodel.systems.simulated.imperfections import Imperfections

THESIS = {
    "stereo-fiducial": (
        "thesis, refined (real robot)",
        {"position_mm": {"mean": 1.99, "sd": 1.24}, "pixels": {"mean": 2.61, "sd": 1.71}},
    ),
    "stereo-color": (
        "thesis, kinematics from cameras (real robot)",
        {"position_mm": {"mean": 3.77, "sd": 2.30}, "pixels": {"mean": 5.78, "sd": 4.50}},
    ),
}
"""Sensor -> what the thesis reports in chapter 8, by colour in chapter 7."""


def learn_by_cameras(
    output: Output,
    sensor: str,
    world: "Imperfections",
    seed: int,
    random_poses: int,
    mirror: bool,
) -> NoReturn:
    """Calibrate the cameras, watch the hand, learn the arm, refine both, write the result."""
    from nico_selfmodel.cli.learn.mirror import mirror_parts, write_mirror_scenario
    from nico_selfmodel.sessions.body_scenario import learn_body
    from nico_selfmodel.sessions.camera_scenario import MARKERS, Counts

    marker = MARKERS[sensor]
    with printer.progress_bar() as progress:
        scenario = learn_body(
            world, seed, marker=marker, counts=Counts(random=random_poses), stage=progress
        )
        seen = None
        if mirror:
            from nico_selfmodel.sessions.mirrors.mirror_scenario import learn_mirror, with_mirror

            familiar = scenario.arm.train.encoders
            seen = learn_mirror(
                scenario.model, world, seed, marker=marker, familiar=familiar, stage=progress
            )
            scenario = with_mirror(scenario, seen)
        document = write_scenario(scenario, marker, output, progress)
        if seen is not None:
            document = write_mirror_scenario(output.out, document, seen)
    parts = _parts(scenario, document, sensor) + mirror_parts(document)
    more = _told_in_words(document)
    printer.result(scenario.model.name, document, output, parts=parts, more=more)


def write_scenario(
    scenario: "BodyScenario", marker: str, output: Output, progress: Progress = telling_nobody
) -> dict[str, Any]:
    """Write the refined body, or the arm as it was before where the refinement was refused.

    Returns:
        What is in its `result.json`.
    """
    from nico_selfmodel.systems.looking import looking_arm

    refined, arm, robot = scenario.refined, scenario.arm, looking_arm(marker)
    beside: dict[str, Any] = {"recordings": {"train": arm.train, "test": arm.test}}
    if refined is not None and scenario.accepted:
        from nico_selfmodel.viz.reports.body import body_report

        found, beside["verdict"] = refined, scenario.verdict
        draw = partial(body_report, refined, robot=robot)
    else:  # the arm as it was learned after the cameras, and why nothing better came of it
        from nico_selfmodel.estimation.judging import result_of
        from nico_selfmodel.viz.reports.arm import arm_report

        found = arm.stereo.with_pixels(result_of(arm.calibration), arm.model)
        beside["robot"] = robot
        draw = partial(arm_report, arm.calibration, robot=robot)
    more = _told(scenario)
    return judge_and_write(found, scenario.model, draw, output, progress, more=more, **beside)


def _told(scenario: "BodyScenario") -> dict[str, Any]:
    """Return what `result.json` tells of the cameras, and of the refinement."""
    from nico_selfmodel.estimation.body.body_result import refinement_block

    cameras = scenario.cameras
    return {
        "refinement": refinement_block(scenario.arm.seen, scenario.refined, scenario.verdict),
        "eyes": {
            "boards": len(cameras.views),
            "rms_px": cameras.cameras.rms,
            "baseline_mm": 1e3 * scenario.model.rig.baseline,
        },
    }


def _parts(
    scenario: "BodyScenario", document: Mapping[str, Any], sensor: str
) -> list[tuple[str, printer.Block]]:
    """Return the errors on held-out poses before and after the refinement, beside the thesis'."""
    label, published = THESIS[sensor]
    refinement = document["refinement"]
    kept = "held out, arm and cameras refined" + ("" if scenario.accepted else " (refused)")
    return [
        ("held out, arm learned after the cameras", refinement["before"]),
        (kept, refinement["after"]),
        ("training", document["train"]),
        (label, {"n": 100, **published}),
    ]


def _told_in_words(document: Mapping[str, Any]) -> list[str]:
    cameras = document["eyes"]
    refused = document["refinement"]["reasons"]
    return [
        f"cameras learned from {cameras['boards']} boards to {cameras['rms_px']:.2f} px",
        *(f"refinement refused, the arm before it is kept: {reason}" for reason in refused),
    ]
