"""Chapter 8 of the thesis: arm and cameras jointly refined, anchored to boards or as published."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.experiments.irreducible_error import Limit
from nico_selfmodel.experiments.projected_nico import TRACKERS, ProjectedNico
from nico_selfmodel.experiments.stereo import BOARDS, TEST_BOARDS, board_points
from nico_selfmodel.model.arm.link_lengths import link_lengths
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.simulated.cameras import SimulatedCameras
from nico_selfmodel.systems.simulated.imperfections import Imperfections

CIRCLE_POINTS = 15
"""Poses on each of the four circles, home not counted."""
RANDOM_POSES = 100
TEST_POSES = 100
CONDITIONS = {
    "kinematics only": BodyOptions("kinematics"),
    "intrinsics pinned, as published": BodyOptions("intrinsics-fixed", "thesis"),
    "full, as published": BodyOptions("full", "thesis"),
    "full, whitened, without boards": BodyOptions("full", "unanchored"),
    "full, anchored": BodyOptions("full", "anchored"),
}
"""What is learned, and how. The seed's principal points are held at the image's centre, as in the
thesis' first pass."""
SEED = CameraOptions(pinned={"cx": None, "cy": None})


@dataclass(frozen=True, eq=False)
class Scenario:
    """What one robot recorded, and what ground truth says of it."""

    train: Dataset
    """Circles and random poses, with pixels."""
    test: Dataset
    """Other random poses; with points, measured from outside in the left camera's frame, if any."""
    cameras: SelfModel
    """The seed: cameras learned from the boards."""
    boards: BoardViews
    """Boards that the cameras were learned from."""
    test_boards: BoardViews
    """Boards that nobody learns from."""
    links: tuple[float, float] | None
    """Lengths of the links by calipers [m]."""
    limit: Limit | None = None
    """What the mechanics leave of the test's errors."""


@dataclass(frozen=True)
class RefinementRow:
    """One condition, averaged over robots. Pairs are mean and SD."""

    tracker: str
    """`fiducial` or `color`."""
    condition: str
    """Key of `CONDITIONS`."""
    runs: int
    """Individuals that it came to an end with."""
    own_mm: tuple[float, float]
    """Distance of the predicted hand from where its own cameras see it, over the test poses."""
    px: tuple[float, float]
    """Error in the images, over the test poses."""
    true_mm: tuple[float, float] | None
    """Distance of the predicted from the real hand: mean and SD over robots."""
    edge_mm: tuple[float, float] | None
    """SD of the edges of held-out boards, before and after."""
    scale_error: float | None
    """Mean of |scale - 1| of held-out boards after."""
    links_mm: tuple[float, float] | None
    """Mean absolute errors of the links."""
    pixel_sigma: float
    """Estimated noise of the tracker [px]."""
    joint_sigma_deg: float
    """Estimated play, as a standard deviation."""
    refused: int
    """Individuals whose result was refused."""
    seconds: float
    """Mean time."""


@dataclass(frozen=True)
class RefinementExperiment:
    """All conditions."""

    world: str
    """What is wrong with the bodies."""
    play_deg: float
    """Half the width of the joints' noise."""
    individuals: int
    """Simulated bodies averaged over."""
    rendered: bool
    """Whether the cameras saw pictures, not numbers with noise on them."""
    rows: tuple[RefinementRow, ...]
    """By tracker, then by condition."""
    limits: tuple[Limit, ...] = ()
    """What the mechanics leave, of every tracker for which that is known."""


ScenarioSource = Callable[[int, tuple[str, ...], Stage | None], Mapping[str, Scenario]]
"""Records one robot: its seed, its trackers, whom to tell -> what each tracker saw."""


def run_refinement(
    world: Imperfections,
    individuals: int = 8,
    seed: int = 0,
    trackers: tuple[str, ...] = ("fiducial", "color"),
    progress: Stage | None = None,
    rendered: ScenarioSource | None = None,
) -> RefinementExperiment:
    """Let simulated bodies learn under every condition.

    Args:
        seed: Of the first.
        rendered: Records a body through rendered pictures; without it nothing is rendered, and what
            the cameras find is the truth with noise on it.

    Raises:
        ValueError: If there is no such tracker.
    """
    for tracker in trackers:
        refuse_unknown("tracker", tracker, TRACKERS)
    found: dict[tuple[str, str], list[dict[str, Any]]] = {
        (tracker, name): [] for tracker in trackers for name in CONDITIONS
    }
    limits: dict[str, list[Limit]] = {tracker: [] for tracker in trackers}
    for i in range(individuals):
        if rendered is None:
            scenarios = _simulated(world, seed + i, trackers)
        else:
            stage = of_robot(progress, i, individuals, "body")
            scenarios = rendered(seed + i, trackers, stage)
        for tracker, scenario in scenarios.items():
            limits[tracker] += [] if scenario.limit is None else [scenario.limit]
            for name, options in CONDITIONS.items():
                measured = measure(scenario, options)
                found[tracker, name] += [] if measured is None else [measured]
        if progress:
            progress("bodies learning", i + 1, individuals)
    rows = tuple(row_of(*key, runs) for key, runs in found.items() if runs)
    play = float(np.degrees(world.play))
    left = tuple(Limit.mean(found) for found in limits.values() if found)
    return RefinementExperiment(world.name, play, individuals, rendered is not None, rows, left)


def _simulated(world: Imperfections, seed: int, trackers: tuple[str, ...]) -> dict[str, Scenario]:
    return {
        tracker: simulated_scenario(ProjectedNico.tracked_by(tracker), world, seed)
        for tracker in trackers
    }


def simulated_scenario(
    nico: ProjectedNico, world: Imperfections, seed: int, random_poses: int = RANDOM_POSES
) -> Scenario:
    """Record one robot.

    Args:
        nico: The robot as described, and how its hand is tracked.
        seed: Which robot.
        random_poses: Poses to learn from beside the circles.
    """
    robot = nico.robot(world, seed)
    rng = np.random.default_rng((seed, 12))
    labels, sweeps = nico.sweeps(CIRCLE_POINTS)
    poses = np.vstack([sweeps, nico.random_poses(random_poses, rng)])
    train = nico.record(robot, "train", poses, labels + [""] * random_poses, seed=seed)
    test = nico.record(robot, "test", nico.random_poses(TEST_POSES, rng), observed=True, seed=seed)
    cameras, truth = SimulatedCameras(seed), robot.ground_truth
    boards = cameras.look_at_boards(board_points(), BOARDS)
    sides = calibrate_cameras(boards, SEED).self_model("cameras")
    held_out = cameras.look_at_boards(board_points(), TEST_BOARDS, session=1)
    limit = Limit.of(nico.tracker, test, *truth.expected(test.encoders))
    return Scenario(train, test, sides, boards, held_out, truth.link_lengths(), limit)


def measure(
    scenario: Scenario, options: BodyOptions, nominal: NominalArm | None = None
) -> dict[str, Any] | None:
    """Learn one body under one condition and measure it from inside and outside.

    Args:
        options: The condition.
        nominal: The robot as described, as a start.

    Returns:
        The measures by name; None where the condition came to no end.
    """
    try:
        found = calibrate_body(
            scenario.train,
            scenario.cameras,
            scenario.boards,
            options,
            test=scenario.test,
            test_boards=scenario.test_boards,
            nominal=nominal,
        )
    except (EstimationError, ModelError):
        return None
    assert found.test is not None
    own, pixels = found.test.statistics, found.test.pixel_statistics
    if own is None or pixels is None:
        return None
    measured: dict[str, Any] = {
        "own_mm": (1e3 * own.mean, 1e3 * own.sd),
        "px": (pixels.mean, pixels.sd),
        "pixel_sigma": found.noise.sensor_sigma,
        "joint_sigma_deg": float(np.degrees(found.noise.joint_sigma)),
        "refused": judge(found).status == "FAIL",
        "seconds": found.seconds,
    }
    if scenario.test.measured.any():
        measured["true_mm"] = 1e3 * evaluate(found.model, scenario.test).statistics.mean
    return measured | _from_boards(found) | _links(found, scenario)


def _from_boards(found: BodyCalibration) -> dict[str, Any]:
    check = found.boards
    if check is None or check.after is None:
        return {}
    return {
        "edge_mm": (1e3 * check.before.edge_sd, 1e3 * check.after.edge_sd),
        "scale_error": abs(float(check.after.scale.mean()) - 1.0),
    }


def _links(found: BodyCalibration, scenario: Scenario) -> dict[str, Any]:
    if scenario.links is None:
        return {}
    errors = np.abs(np.subtract(link_lengths(found.model.chain), scenario.links))
    return {"links_mm": (1e3 * float(errors[0]), 1e3 * float(errors[1]))}


def row_of(tracker: str, condition: str, runs: list[dict[str, Any]]) -> RefinementRow:
    """Average the measures of several robots."""

    def mean(name: str) -> float | None:
        values = [run[name] for run in runs if name in run]
        return float(np.mean(values)) if values else None

    own, pixels = mean_pair(runs, "own_mm"), mean_pair(runs, "px")
    assert own is not None
    assert pixels is not None
    true = [run["true_mm"] for run in runs if "true_mm" in run]
    return RefinementRow(
        tracker,
        condition,
        len(runs),
        own,
        pixels,
        (float(np.mean(true)), float(np.std(true))) if true else None,
        mean_pair(runs, "edge_mm"),
        mean("scale_error"),
        mean_pair(runs, "links_mm"),
        mean("pixel_sigma") or 0.0,
        mean("joint_sigma_deg") or 0.0,
        sum(run["refused"] for run in runs),
        mean("seconds") or 0.0,
    )


def mean_pair(runs: Sequence[Mapping[str, Any]], name: str) -> tuple[float, float] | None:
    """Return the mean of means and of SDs over those robots that have one."""
    values = np.array([run[name] for run in runs if name in run])
    return (float(values[:, 0].mean()), float(values[:, 1].mean())) if len(values) else None
