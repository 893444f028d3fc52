"""One self-model: arm and cameras refine each other (thesis chapter 8, put right).

The thesis minimises the pixels of the hand alone. That leaves the scale open and so much else
nearly so that its own 3D error falls while the true one grows tenfold. Here the chessboard corners
stay in the same problem, which holds scale and lenses, and each pose's pixels are whitened with
tracker noise and joint noise, both estimated.
"""

import time
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.held_out import held_out_of
from nico_selfmodel.estimation.bending.ladder import Ladder, climb
from nico_selfmodel.estimation.bending.steps import STEPS
from nico_selfmodel.estimation.body.bending_body import BendingBody
from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.body.body_cross_validation import cross_validate_body
from nico_selfmodel.estimation.body.body_initialization import body_start, lines_of, named_like
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.estimation.body.body_problem import BodyProblem, arm_and_cameras, outlier_rows
from nico_selfmodel.estimation.body.body_uncertainty import (
    body_uncertainty,
    noise_sigmas,
    open_at,
    position_sigma,
)
from nico_selfmodel.estimation.body.seen_body import SeenBody
from nico_selfmodel.estimation.cameras.board_accuracy import held_out_residuals
from nico_selfmodel.estimation.cameras.board_check import BoardCheck
from nico_selfmodel.estimation.cameras.camera_adjustment import OUTLIER_RATIO
from nico_selfmodel.estimation.cameras.camera_calibration import FEWEST_VIEWS
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.noise.hand_observations import JOINT_SIGMA
from nico_selfmodel.estimation.noise.training_noise import with_training_noise
from nico_selfmodel.estimation.observations.observations import gears_known
from nico_selfmodel.estimation.observations.parameter_scales import arm_size
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation, evaluate_pixels
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.estimation.results.provenance import data_named, package_versions
from nico_selfmodel.estimation.tree.bending_tree import TreeBend
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.optimization.uncertainty import Uncertainty

FEWEST_ROWS = 8
"""Poses seen by both cameras below which nothing is left to tell an error by."""


@on_one_blas_thread
def calibrate_body(
    dataset: Dataset,
    start: SelfModel,
    boards: BoardViews | None = None,
    options: BodyOptions | None = None,
    *,
    test: Dataset | None = None,
    test_boards: BoardViews | None = None,
    nominal: NominalArm | None = None,
    name: str | None = None,
    seed: int = 0,
    effects: Sequence[str] = STEPS,
    up: NDArray | None = None,
) -> BodyCalibration:
    """Refine arm and cameras by the pixels in which the cameras saw the hand.

    Args:
        dataset: Encoder readings and pixels.
        start: Cameras, and the arm if it is known; else it is learned from what stereo
            reconstructs.
        boards: Views of a chessboard by both cameras, for the anchored variant.
        options: Stage, variant, pins; by default the full anchored model.
        test: Held-out data, for judging only.
        test_boards: Held-out boards, for judging only; the training boards judge where missing.
        nominal: The robot as described, for the zero of the joints and as a start.
        name: Name of the self-model; the start's if omitted.
        seed: Of random starts, where the arm is learned from scratch.
        effects: What may bend, of `estimation.bending.steps.STEPS`: kept where unseen poses gain.
            With none they are asked for all the same, to tell what they would explain.
        up: Unit vertical in the left camera's frame, for sag; the first axis and the frame's are
            tried if omitted. Shape (3,).

    Returns:
        The calibration. A failed check does not raise: see `estimation.judging.judge`.

    Raises:
        DataError: If the data have no pixels, too few seen by both cameras, or other joints.
        ModelError: If the start has not both cameras.
        NotConvergedError: If cameras or gears that cannot be come out.
        ValueError: If an option names no parameter, or boards are missing.
    """
    clock, options = time.perf_counter(), options or BodyOptions()
    test = None if test is None else held_out_of(dataset, test)
    _require_boards(options, boards)
    pinned = frozenset(options.pins.pinned)
    start, dataset, label = body_start(dataset, start, nominal, seed, pinned)
    observations = PixelObservations.from_dataset(dataset)
    boards, outlying = _inlier_boards(boards, start.rig)
    task = _Task(dataset, observations, start, boards if options.anchored else None, options)
    task.require_poses()
    rigid, iterations = task.solve()
    ladder = task.climbed(rigid, effects, up, seed)
    found: TreeBend = ladder.solution
    seen, solution = task.seen, found.solution
    parameters, rig = arm_and_cameras(found)
    outliers, noise = outlier_rows(seen, found), task.noise(found)
    inliers = observations.select(~outliers)
    uncertainty = ladder.in_doubt(body_uncertainty(found, observations), found.posture)
    crossed = cross_validate_body(found, seen, outliers, noise.sensor_sigma)
    training = _training_of(dataset, observations, crossed)
    model = task.model(parameters, rig, noise, outliers, uncertainty, name or start.name, training)
    judged = test_boards if test_boards is not None else boards
    check = None
    if judged is not None and options.stage != "kinematics":
        check = BoardCheck.from_rigs(start.rig, rig, judged, test_boards is not None)
    return BodyCalibration(
        model,
        start,
        label,
        options,
        evaluate_pixels(model, dataset),
        None if test is None else evaluate_pixels(model, test),
        evaluate_pixels(start, dataset if test is None else test),
        crossed,
        outliers,
        noise,
        noise_sigmas(inliers, parameters, rig, noise),
        seen.corner_sigma_of(solution.noise),
        uncertainty,
        check,
        outlying,
        task.scale_from,
        solution.converged,
        iterations + solution.iterations * (found is not rigid),
        time.perf_counter() - clock,
        ladder,
    )


def _require_boards(options: BodyOptions, boards: BoardViews | None) -> None:
    both = 0
    if boards is not None and len(boards.cameras) == 2:
        both = int(np.all(boards.seen.any(axis=2), axis=1).sum())
    if options.anchored and both < FEWEST_VIEWS:
        raise ValueError(
            f"the anchored variant needs views of a chessboard by both cameras, {FEWEST_VIEWS} at "
            f"least, which carry the scale and hold the lenses; got {both}: give boards, or choose "
            "variant 'unanchored' knowing that its true error may grow while its own falls"
        )


def _inlier_boards(boards: BoardViews | None, rig: StereoRig) -> tuple[BoardViews | None, NDArray]:
    """Return the boards that fit the seed's cameras like the rest, and which do not. Shape (V,)."""
    if boards is None:
        return None, np.zeros(0, dtype=bool)
    r = held_out_residuals(rig.cameras, boards)
    rms = np.sqrt(np.nanmean(r**2, axis=(1, 2)))
    outlying = rms > OUTLIER_RATIO * np.median(rms)
    return boards.select(~outlying), outlying


def _training_of(
    dataset: Dataset, observations: PixelObservations, crossed: PixelEvaluation | None
) -> dict[str, Any]:
    """Return what tells later whether the model is used beyond what it was trained for."""
    readings = dataset.encoders[observations.arm.rows]
    ranges = np.stack([readings.min(axis=0), readings.max(axis=0)], axis=1).tolist()
    training: dict[str, Any] = {
        "rows": len(observations),
        "readings": dict(zip(dataset.joint_names, ranges, strict=True)),
    }
    errors = np.zeros(0) if crossed is None else crossed.distances
    if len(errors):
        assert crossed is not None
        training["expected_error"] = {
            "n": len(errors),
            "median_m": float(np.median(errors)),
            "median_px": float(np.median(crossed.pixel_distances)),
        }
    return training


class _Task:
    """What one calibration works on."""

    def __init__(
        self,
        dataset: Dataset,
        observations: PixelObservations,
        start: SelfModel,
        boards: BoardViews | None,
        options: BodyOptions,
    ) -> None:
        self.dataset, self.observations, self.start = dataset, observations, start
        self.options, self.anchored = options, boards is not None
        self.gear_known = gears_known(observations.arm.units)
        self.held_cameras = options.held_cameras(start.rig)
        self.pins = options.arm_pins
        self.pins.check(start.parameters)
        self.alone = SeenBody.of(observations, dataset, None)
        self.seen = self.alone if boards is None else SeenBody.of(observations, dataset, boards)

    @property
    def held_gears(self) -> frozenset[str]:
        """Gears that stay: of joints read in rad or deg, and those pinned."""
        joints = zip(self.observations.arm.joints, self.gear_known, strict=True)
        held = {f"{joint}.gear" for joint, known in joints if known} | set(self.pins.pinned)
        return frozenset(n for n in held if n.endswith(".gear") and n not in self.pins.freed)

    @property
    def scale_from(self) -> str:
        """What holds the scale."""
        if self.anchored:
            return "boards"
        if self.options.stage == "kinematics":
            return "cameras"
        return self.options.scale_name(self.start.rig)

    @cached_property
    def first(self) -> tuple[DhParameters, StereoRig]:
        """Arm and cameras to begin with, at what the user holds of gears and cameras."""
        lines = lines_of(self.start, self.observations.arm.markers)
        arm = named_like(lines, self.start, self.gear_known)
        values = dict(zip(arm.names, arm.values.tolist(), strict=True))
        held = self.held_gears
        values |= {n: v for n, v in self.pins.pinned.items() if v is not None and n in held}
        rig = self.start.rig
        cameras = dict(zip(rig.names, rig.values.tolist(), strict=True))
        cameras |= {n: v for n, v in self.held_cameras.items() if v is not None}
        moved = np.array([cameras[n] for n in rig.names])
        arm = arm.with_values(np.array([values[n] for n in arm.names]))
        return arm, rig.with_values(moved)

    def _problem(self, seen: SeenBody) -> BodyProblem:
        options = self.options
        return BodyProblem(seen, self.start, options.whitened, options.loss != "none")

    def require_poses(self) -> None:
        """Refuse too few poses, and name what they would leave unobservable.

        Raises:
            DataError: If so.
        """
        arm, rig = self.first
        free = self.free_names(arm)
        of_arm = free & frozenset(self.start.parameters.names)
        fewest = max(FEWEST_ROWS, -(-len(of_arm) // 3))
        if self.observations.by_both.sum() < fewest:
            problem = self._problem(self.seen).named(arm, rig, free)
            unobservable = open_at(problem, arm_size(self.start))
            self.observations.require_both_cameras(fewest, self.dataset.name, unobservable)

    def solve(self) -> tuple[TreeBend, int]:
        """Refine the arm alone, then what the stage frees; as lines, then by name.

        Returns:
            The rigid body, and how many iterations it took.
        """
        arm, rig = self.first
        cameras = frozenset(self.options.at("kinematics").held_cameras(rig))
        arm, _, lines = self._problem(self.alone).by_lines(arm, rig, self.held_gears | cameras)
        iterations, problem = lines.solution.iterations, self._problem(self.seen)
        if self.options.stage != "kinematics":
            held = self.held_gears | frozenset(self.held_cameras)
            arm, rig, lines = problem.by_lines(arm, rig, held, lines.solution)
            iterations += lines.solution.iterations
        values = {} if self.pins.only_gears else self._pinned_values()
        found = problem.by_name(arm, rig, self.free_names(arm), lines, values)
        self.pins.refuse_turned_gears(arm_and_cameras(found)[0].gears)
        return found, iterations + found.solution.iterations

    def _pinned_values(self) -> dict[str, float]:
        """Return where the user holds parameters of the arm."""
        start = self.start.parameters
        known = dict(zip(start.names, start.values.tolist(), strict=True))
        pinned = self.pins.pinned.items()
        return {n: known[n] if value is None else value for n, value in pinned}

    def free_names(self, parameters: DhParameters) -> frozenset[str]:
        """Return the names of everything that was estimated."""
        pinned = parameters.gauge | self.held_gears | frozenset(self.pins.pinned)
        arm = frozenset(parameters.names) - (pinned - self.pins.freed)
        return arm | (frozenset(self.start.rig.names) - frozenset(self.held_cameras))

    def climbed(
        self, rigid: TreeBend, effects: Sequence[str], up: NDArray | None, seed: int
    ) -> Ladder:
        """Ask the rigid body what bends; nothing where pixels are not weighed by their noise."""
        body = BendingBody(rigid, frozenset(self.pins.pinned), up, seed)
        return climb(body, effects if self.options.whitened else None)

    def noise(self, found: TreeBend) -> HandNoise:
        """Return what disturbs the hand's pixels; of exact joints what would, did they err."""
        if self.options.whitened:
            return self.seen.noise_of(found.solution.noise)
        likely = BodyProblem(self.seen, self.start).as_if_joints_erred(found)
        return self.seen.noise_of(likely)

    def model(
        self,
        parameters: DhParameters,
        rig: StereoRig,
        noise: HandNoise,
        outliers: NDArray,
        uncertainty: Uncertainty,
        name: str,
        training: dict[str, Any],
    ) -> SelfModel:
        """Assemble the self-model."""
        options, dataset = self.options, self.dataset
        fit = {
            "method": f"body, {options.stage}, {options.variant}",
            "loss": options.loss,
            **training,
            JOINT_SIGMA: noise.joint_sigma,
        }
        model = SelfModel(
            name,
            parameters.table,
            parameters.servos,
            ParameterCovariance(uncertainty.names, uncertainty.covariance),
            position_sigma(self.observations, parameters, noise),
            self.start.robot,
            fit,
            {
                **data_named(dataset),
                "start": self.start.name,
                **package_versions("drake"),
            },
            {"left": rig.left, "right": rig.right},
            noise.sensor_sigma,
            bending=parameters.bending,
        )
        return with_training_noise(model, dataset, "pixels", self.observations.arm.sample[outliers])
