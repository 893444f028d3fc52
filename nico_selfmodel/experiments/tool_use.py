"""Section 8.4.4 of the thesis: a screwdriver in the hand, and a restart of the encoders."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, rezero
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import TEST_POSES, mean_pair, simulated_scenario
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.robot import SimulatedRobot
from nico_selfmodel.systems.simulated.sensors import StereoPixels

TOOL = np.array([0.025, 0.0, -0.08])
"""From the finger tip to the screwdriver's, along the base's axes at q = 0 [m]."""
TIP_SIGMA = 1.5
"""Noise of a patch of 1 cm on the tip [px]."""
COUNTS = (3, 10, 20, 52)
"""Poses with the tool; the thesis has 52."""
ZERO_COUNTS = (3, 5, 10)
"""Poses after a restart."""
FREED = {"point": "tip alone", "body": "all else too, as known"}
"""What is learned with a tool, and how it is called."""


@dataclass(frozen=True, eq=False)
class ToolScenario:
    """What one robot recorded with a tool in its hand."""

    model: SelfModel
    """What it knew of itself before, from pictures of its bare hand."""
    hand: Dataset
    """Held-out poses of the bare hand."""
    taken: Dataset
    """Poses with the tool to learn from, `COUNTS[-1]` at most."""
    shown: Dataset
    """Held-out poses with the tool."""


@dataclass(frozen=True)
class ToolRow:
    """One way of learning from some poses, averaged over robots. Pairs are mean and SD."""

    what: str
    """In words."""
    poses: int
    """Learned from; 0 before anything was learned."""
    own_mm: tuple[float, float] | None
    """Distance of the predicted tip from where the own cameras see it: the thesis' measure."""
    px: tuple[float, float] | None
    """Error in the images on held-out poses."""
    true_mm: tuple[float, float] | None
    """Distance from the real tip or hand: mean, and largest mean of a robot."""


@dataclass(frozen=True)
class ToolExperiment:
    """All rows."""

    world: str
    """What is wrong with the bodies."""
    play_deg: float
    """Half the width of the joints' noise."""
    individuals: int
    """Simulated bodies averaged over."""
    rendered: bool
    """Whether the cameras saw pictures, not numbers with noise on them."""
    tool: tuple[ToolRow, ...]
    """With the tool."""
    restart: tuple[ToolRow, ...]
    """After the encoders lost their zeros; empty if rendered."""


ToolScenarioSource = Callable[[int, Stage | None], ToolScenario]
"""Records one robot: its seed, whom to tell -> what it recorded."""


def run_tool(
    world: Imperfections,
    individuals: int = 8,
    seed: int = 0,
    progress: Stage | None = None,
    rendered: ToolScenarioSource | None = None,
) -> ToolExperiment:
    """Let simulated bodies take a tool, and restart them.

    Args:
        seed: Of the first.
        rendered: Records a body through rendered pictures; there is no restart then. Without it
            nothing is rendered.
    """
    tools: list[dict[str, dict[str, Any]]] = []
    restarts: list[dict[str, dict[str, Any]]] = []
    for i in range(individuals):
        if rendered is None:
            tools.append(_with_tool(simulated_tool_scenario(world, seed + i)))
            restarts.append(_after_restart(world, seed + i))
        else:
            tools.append(_with_tool(rendered(seed + i, progress)))
        if progress:
            progress("bodies learning", i + 1, individuals)
    play = float(np.degrees(world.play))
    found = (_rows(tools), _rows(restarts))
    return ToolExperiment(world.name, play, individuals, rendered is not None, *found)


def learned_body(
    nico: ProjectedNico, world: Imperfections, seed: int
) -> tuple[SimulatedRobot, SelfModel, Dataset]:
    """Return a robot, what it learned of itself, and poses to test it on."""
    scenario = simulated_scenario(nico, world, seed)
    model = calibrate_body(scenario.train, scenario.cameras, scenario.boards).model
    return nico.robot(world, seed, session=1), model, scenario.test


def simulated_tool_scenario(world: Imperfections, seed: int) -> ToolScenario:
    """Let one robot learn itself by colour, take a tool, and look at its tip."""
    nico = ProjectedNico.tracked_by("color")
    robot, model, hand = learned_body(nico, world, seed)
    rng = np.random.default_rng((seed, 13))
    robot.faults.take_tool(TOOL)
    robot.sensor = StereoPixels(TIP_SIGMA)
    tests = nico.random_poses(TEST_POSES, rng, TOOL)
    shown = nico.record(robot, "tip", tests, observed=True)
    taken = nico.record(robot, "tool", nico.random_poses(COUNTS[-1], rng, TOOL))
    return ToolScenario(model, hand, taken, shown)


def _with_tool(scenario: ToolScenario) -> dict[str, dict[str, Any]]:
    """Learn the tip from more and more poses, and measure each result."""
    model = scenario.model
    bare = replace(scenario.shown, marker=np.full(len(scenario.shown), model.markers[0]))
    rows = {
        "hand before": {"poses": 0, **_errors(model, scenario.hand)},
        "tool, nothing learned": {"poses": 0, **_errors(model, bare)},
    }
    tip = replace(scenario.shown, marker=np.full(len(scenario.shown), "tip"))
    for count in COUNTS:
        first = scenario.taken.select(
            np.isin(scenario.taken.sample, scenario.taken.samples[:count])
        )
        for free, words in FREED.items():
            found = calibrate_tool(model, first, tool="tip", free=free)
            errors = _errors(found.model, tip)
            rows[f"tool, {count} poses, {words}"] = {"poses": count, **errors}
    return rows


def _after_restart(world: Imperfections, seed: int) -> dict[str, dict[str, Any]]:
    nico = ProjectedNico.tracked_by("fiducial")
    robot, model, test = learned_body(nico, world, seed)
    rng = np.random.default_rng((seed, 14))
    rows = {"before the restart": {"poses": 0, **_errors(model, test)}}
    robot.faults.restart(seed)
    shown = nico.record(robot, "after", nico.random_poses(TEST_POSES, rng), observed=True)
    rows["after the restart"] = {"poses": 0, **_errors(model, shown)}
    for count in ZERO_COUNTS:
        poses = nico.record(robot, "zeros", nico.random_poses(count, rng))
        found = rezero(model, poses).model
        rows[f"zeros from {count} poses"] = {"poses": count, **_errors(found, shown)}
    return rows


def _errors(model: SelfModel, test: Dataset) -> dict[str, Any]:
    """Return the errors on held-out poses from inside, and from outside where that is known."""
    seen = evaluate_pixels(model, test)
    found: dict[str, Any] = {}
    if seen.pixel_statistics is not None:
        found["px"] = (seen.pixel_statistics.mean, seen.pixel_statistics.sd)
    if seen.statistics is not None:
        found["own_mm"] = (1e3 * seen.statistics.mean, 1e3 * seen.statistics.sd)
    if test.measured.any():
        found["true"] = 1e3 * evaluate(model, test).statistics.mean
    return found


def _rows(runs: list[dict[str, dict[str, Any]]]) -> tuple[ToolRow, ...]:
    rows = []
    for what in runs[0] if runs else ():
        found = [run[what] for run in runs]
        true = [one["true"] for one in found if "true" in one]
        worst = (float(np.mean(true)), float(np.max(true))) if true else None
        own, px = mean_pair(found, "own_mm"), mean_pair(found, "px")
        rows.append(ToolRow(what, found[0]["poses"], own, px, worst))
    return tuple(rows)
