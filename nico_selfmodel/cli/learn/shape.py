"""The part of `nico-selfmodel learn` in which the robot learns its own shape: `--shape`."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.learn.mirror import mirror_parts, write_mirror_scenario
from nico_selfmodel.cli.option_groups import Output
from nico_selfmodel.cli.result_files import judge_and_write

if TYPE_CHECKING:
    from nico_selfmodel.model.shape.link_shape import BodyShape
    from nico_selfmodel.progress import Progress
    from nico_selfmodel.sessions.mirrors.own_shape import ShapeScenario
    from nico_selfmodel.systems.simulated.imperfections import Imperfections


def learn_shape(output: Output, world: "Imperfections", seed: int) -> NoReturn:
    """Learn cameras, arm, mirrors, and the shape of head and chest in them; write the result."""
    from nico_selfmodel.sessions.mirrors.own_shape import learn_own_shape

    with printer.progress_bar() as progress:
        scenario = learn_own_shape(world, seed, progress)
        document = _write_shape_scenario(scenario, output, progress)
    parts = [
        ("held out", document["test"]),
        ("training", document["train"]),
        *mirror_parts(document),
    ]
    more = told_in_words(document)
    printer.result(scenario.model.name, document, output, parts=parts, more=more)


def _write_shape_scenario(
    scenario: "ShapeScenario", output: Output, progress: "Progress"
) -> dict[str, Any]:
    """Write arm, cameras, mirrors and shape to a result folder; return its `result.json`."""
    from nico_selfmodel.estimation.judging import result_of
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.viz.reports.arm import arm_report

    arm, robot = scenario.arm, ArmDescription.of_model(scenario.model)
    shape, mirrors = scenario.shape.body, len(scenario.shape.all.standpoints)
    calibration = replace(arm.calibration, model=scenario.model)
    result = arm.stereo.with_pixels(result_of(calibration), scenario.model)
    document = judge_and_write(
        result,
        scenario.model,
        partial(arm_report, calibration, robot=robot),
        output,
        progress,
        more={"shape": shape_document(shape, mirrors=mirrors)},
        robot=robot,
        recordings={"train": arm.train, "test": arm.test},
        shape=shape,
    )
    return write_mirror_scenario(output.out, document, scenario.mirrors)


def shape_document(shape: "BodyShape", **seen_in: int) -> dict[str, Any]:
    """Return what `result.json` tells of a learned shape.

    Args:
        seen_in: In how many `mirrors` or `poses`.
    """
    import numpy as np

    return {
        **seen_in,
        "links": {
            link: {
                "vertices": len(own.seen),
                "seen": int(own.seen.sum()),
                "sigma_mm": 1e3 * float(np.median(own.sigma[own.seen])) if own.seen.any() else None,
            }
            for link, own in shape.links.items()
        },
    }


def told_in_words(document: Mapping[str, Any]) -> list[str]:
    """Return what a document tells of the shape of each link."""
    shape = document["shape"]
    where = next(f"{shape[what]} {what}" for what in ("mirrors", "poses") if what in shape)
    return [_of_link(link, own, where) for link, own in shape["links"].items()]


def _of_link(link: str, own: Mapping[str, Any], where: str) -> str:
    if not own["seen"]:
        return f"shape of {link}: not known, no place was seen often enough in {where}"
    return (
        f"shape of {link}, in {where}: {own['seen']} of {own['vertices']} vertices seen, "
        f"to {own['sigma_mm']:.1f} mm (median sigma)"
    )
