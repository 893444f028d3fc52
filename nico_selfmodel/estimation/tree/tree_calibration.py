"""Calibration of any body by any sensors: first body, adjustment, noise, error bars."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.bending.ladder import Ladder, climb
from nico_selfmodel.estimation.bending.steps import STEPS
from nico_selfmodel.estimation.bending.what_bends import At
from nico_selfmodel.estimation.diagnosis.changes_in_time import Change
from nico_selfmodel.estimation.diagnosis.flatness import Flatness
from nico_selfmodel.estimation.tree.bending_tree import BendingTree, TreeBend, tree_at
from nico_selfmodel.estimation.tree.boards.lenses_by_boards import lenses_by_boards
from nico_selfmodel.estimation.tree.compared_errors import usual_errors
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import (
    refuse_behind,
    refuse_odd_sensor,
)
from nico_selfmodel.estimation.tree.contradictions.heavy_tails import noise_to_expect
from nico_selfmodel.estimation.tree.contradictions.held_scores import HeldScore, held_scores
from nico_selfmodel.estimation.tree.contradictions.mended_readings import start_as_it_was_read
from nico_selfmodel.estimation.tree.contradictions.no_pose_tells import told_by_no_pose
from nico_selfmodel.estimation.tree.contradictions.ran_away import (
    check_that_it_stayed,
    what_led_away,
)
from nico_selfmodel.estimation.tree.contradictions.standing_still import check_that_it_moved
from nico_selfmodel.estimation.tree.contradictions.told_values import agreeing_start
from nico_selfmodel.estimation.tree.contradictions.unplaced_markers import (
    hardly_seen,
    unplaced_markers,
    without_markers,
)
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.lens_guess import PARTS, guessed_lenses
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart, agreeing, searched_start
from nico_selfmodel.estimation.tree.known.described_scale import DescribedScale, doubting
from nico_selfmodel.estimation.tree.known.known_poses import with_known_poses
from nico_selfmodel.estimation.tree.known.lens_parts import LensPart
from nico_selfmodel.estimation.tree.timing.late_sensors import late_sensors
from nico_selfmodel.estimation.tree.tree_errors import (
    TreeErrors,
    cross_validate_tree,
    errors_as_described,
    errors_of,
)
from nico_selfmodel.estimation.tree.tree_noise import names_of_noise
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import (
    Description,
    TreeSetup,
    Wishes,
    blank_body,
    moving_joints,
)
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.estimation.tree.tree_start import TreeStart
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.free_joints import body_alone
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.optimization.uncertainty import Uncertainty, scales_by_priors

_ASTRAY = 30.0
"""Median distances from the middle beyond which a few wrong sights put a marker."""


@dataclass(frozen=True, eq=False)
class TreeCalibration:
    """A body learned from a recording, with all that it is judged by."""

    tree: BodyTree
    """The body."""
    name: str
    """Its name."""
    data: BodyDataset
    """What it was learned from."""
    setup: TreeSetup
    """What was free, what stood for the world, what held the scale."""
    parameters: TreeParameters
    """Names and values are told from these."""
    solution: TreeSolution
    """The adjustment."""
    uncertainty: Uncertainty
    """Covariance of what was free."""
    train: TreeErrors
    """Of the training data."""
    test: TreeErrors | None
    """Of held-out data."""
    cross_validation: TreeErrors | None
    """Of the training data, each pose predicted without its fold."""
    described: TreeErrors | None
    """Of the robot as described, sensors and markers placed; on the held-out data, if any."""
    label: str
    """Where the best first body came from."""
    starts: int
    """How many first bodies were tried."""
    agreeing: int
    """How many of them reached the best minimum."""
    seconds: float
    """Time taken."""
    description: Description | None = field(default=None)
    """The robot as described, where it was."""
    ladder: Ladder = field(default=Ladder((), None))
    """What was asked to bend, and what came of it; its solutions are `TreeBend`."""
    flatness: Mapping[str, Flatness | None] = field(default_factory=dict)
    """Whether mirrors are flat, by name, where that was tested; None where there was too little."""
    unplaced: Mapping[str, int] = field(default_factory=dict)
    """Markers that were seen too seldom to be placed, and how often."""
    anew: bool = False
    """Whether a few parameters of a known body were learned, which here is taken for exact."""
    meanwhile: Change | None = None
    """What changed in the middle of a recording of a known body, where that was asked."""
    late: Change | None = None
    """What is of another moment than the rest, if anything is."""
    by_description: DescribedScale | None = None
    """What tells lengths where a description alone does, and little how far that is off."""

    @cached_property
    def _told(self) -> tuple[dict[str, HeldScore], tuple[LensPart, ...]]:
        bend = self.ladder.solution
        return ({}, ()) if self.anew else held_scores(bend.problem, bend.solution)

    @cached_property
    def held(self) -> dict[str, HeldScore]:
        """What the recording says against lengths that it is told; nothing if `anew`."""
        return self._told[0]

    @property
    def lens_parts(self) -> tuple[LensPart, ...]:
        """Which numbers of lenses that it is told it contradicts; none if `anew`."""
        return self._told[1]

    @cached_property
    def told_by_no_pose(self) -> tuple[bool, ...]:
        """Which of `uncertainty.unobservable` are open whatever poses are recorded."""
        problem, solution = self.ladder.solution.problem, self.ladder.solution.solution
        natural = _natural_scales(problem, solution)
        return told_by_no_pose(self.uncertainty, problem, solution, natural)

    @cached_property
    def size(self) -> float:
        """About how far its markers are spread [m]; 0.1 at least."""
        return _size(self.tree, self.data)

    @cached_property
    def noise(self) -> dict[str, float]:
        """Standard deviations to expect of sensors and joints, by name [m, rad or px]."""
        expected = noise_to_expect(self.ladder.solution.problem, self.solution)
        return names_of_noise(expected, self.train.observations)

    @cached_property
    def usual(self) -> NDArray | None:
        """See `usual_errors`, of the training data."""
        return usual_errors(self.tree, self.train.observations, self.noise)

    @cached_property
    def usual_test(self) -> NDArray | None:
        """The same of held-out data, if any."""
        seen = None if self.test is None else self.test.observations
        # Boards that moved freely in training are no part of what is held out.
        return None if seen is None else usual_errors(body_alone(self.tree), seen, self.noise)

    @cached_property
    def values(self) -> NDArray:
        """Values of all parameters. Shape (P,)."""
        return self.solution.values

    @cached_property
    def posed(self) -> BodyDataset:
        """The training data with the poses of what moves freely as they were learned."""
        if not self.data.free_joints:
            return self.data
        residuals = TreeResiduals(self.train.observations, self.parameters)
        return self.data.with_whole_poses(residuals.whole_poses(self.tree))

    @property
    def at(self) -> At:
        """Where markers on links are at the training poses, whatever bends in the body."""
        return tree_at(self.tree, self.posed)


@on_one_blas_thread
def calibrate_tree(
    data: BodyDataset,
    *,
    test: BodyDataset | None = None,
    description: Description | None = None,
    lenses: Mapping[str, Camera] | None = None,
    wishes: Wishes | None = None,
    name: str | None = None,
    seed: int = 0,
    effects: Sequence[str] = STEPS,
    up: NDArray | None = None,
) -> TreeCalibration:
    """Learn a body from all that any sensors measured of it.

    Args:
        test: Held-out data, for judging only.
        description: The robot as described: a first guess, and priors on its frames.
        lenses: Intrinsics of cameras, by name; the recording's own where they are not given.
            What neither tells is learned, where boards or markers at nearly known places tell it.
        name: Name of the body; the recording's if omitted.
        effects: What may bend, of `estimation.bending.steps.STEPS`: kept where unseen poses gain.
            With none they are asked for all the same, to tell what they would explain.
        up: Unit vertical in W, for sag; the first axis that turns, and W's, if omitted. Shape (3,).

    Returns:
        The calibration. A failed check does not raise: see `estimation.judging.judge`.

    Raises:
        DataError: If the recording cannot tell a first body, nothing moved in it, it contradicts
            units or values that it is told, or nothing stands for the world.
        ValueError: If a name does not exist.
    """
    clock = time.perf_counter()
    wishes = with_known_poses(data, description, wishes or Wishes())
    by_boards, inside = lenses_by_boards(data, lenses or {})
    told = {**by_boards, **(lenses or {})}
    guessed = guessed_lenses(data, told, description, seed)
    blank = blank_body(data, {**told, **guessed})
    wishes = wishes.freeing(inside | {f"{name}.{part}" for name in guessed for part in PARTS})
    if description is not None:
        described = replace(description.tree, lenses=blank.lenses)
        description = replace(description, tree=described)
    moving = moving_joints(data, TreeParameters(blank))
    check_that_it_moved(data, moving, described=description is not None)

    def search(data: BodyDataset, most: int | None = None) -> FoundStart:
        return searched_start(data, blank, description, wishes, seed, guessed, most)

    found = start_as_it_was_read(data, moving, search, seed, described=description is not None)
    refuse_odd_sensor(found, data, search, seed)
    first = agreeing_start(found.start, found.tree, wishes, found.scalars, found.begin)
    held, masses = frozenset(wishes.pins.pinned), description and description.masses
    bends = partial(_bent, held=held, effects=effects, up=up, seed=seed, masses=masses)
    refined = found.refined if first is found.start else first.refined(found.observations)
    refuse_behind(first.parameters.tree_of(refined[1].values), refined[0].observations)
    return _finished(first, refined, data, test, description, name, found.costs, clock, bends)


def refit_tree(
    tree: BodyTree,
    data: BodyDataset,
    free: Collection[str],
    *,
    world: str,
    name: str | None = None,
    noise: TreeNoise | None = None,
    test: BodyDataset | None = None,
    start: str = "the body as it was",
    begin: BodyTree | None = None,
) -> TreeCalibration:
    """Learn some parameters of a known body anew; everything else stays.

    Args:
        tree: The body as it was.
        data: What was measured since.
        world: What stood for the world.
        name: Of the body; the recording's if omitted.
        noise: What disturbs the recording, where that is known; estimated if omitted.
        test: Held-out data, for judging only.
        start: Where the body comes from, in words.
        begin: Where the search begins; the body as it was if omitted.

    Raises:
        DataError: If the recording has fewer numbers than there are parameters.
        ValueError: If a name does not exist.
    """
    clock, parameters = time.perf_counter(), TreeParameters(tree)
    for one in sorted(free):
        refuse_unknown("parameter", one, parameters.names)
    setup = TreeSetup(frozenset(free), {}, {}, world, world)
    first = TreeStart(start, parameters, setup, parameters.values_of(begin or tree), 0.0)

    def as_it_was(problem: TreeProblem, solution: TreeSolution) -> Ladder:
        return Ladder((), TreeBend(problem, solution))

    refined = first.refined(TreeObservations.of(data), noise)
    return _finished(first, refined, data, test, None, name, [0.0], clock, as_it_was, anew=True)


def _bent(
    problem: TreeProblem,
    solution: TreeSolution,
    *,
    held: frozenset[str],
    effects: Sequence[str],
    up: NDArray | None,
    seed: int,
    masses: tuple[NDArray, NDArray] | None,
) -> Ladder:
    """Ask a rigid body what bends."""
    return climb(BendingTree(TreeBend(problem, solution), held, up, seed, masses), effects)


def _finished(
    start: TreeStart,
    refined: tuple[TreeProblem, TreeSolution],
    data: BodyDataset,
    test: BodyDataset | None,
    description: Description | None,
    name: str | None,
    costs: Sequence[float],
    clock: float,
    bends: Callable[[TreeProblem, TreeSolution], Ladder],
    *,
    anew: bool = False,
) -> TreeCalibration:
    parameters, setup = start.parameters, start.setup
    problem, rigid = refined
    cause = what_led_away(problem.observations, rigid, setup)
    lost = hardly_seen(data, ~rigid.outliers)
    check_that_it_stayed(parameters, start.values, rigid.values, cause, lost)
    late, ladder = None if anew else late_sensors(problem, rigid, test), bends(problem, rigid)
    bent = ladder.solution
    if late is not None and ladder.adopted:  # what bends may depend on how joints move, too
        late = late_sensors(bent.problem, bent.solution, test, bends=True) and late
    if late is not None and late.explains:
        ladder = Ladder((), TreeBend(problem, rigid))
    problem, solution = ladder.solution.problem, ladder.solution.solution
    residuals, parameters = problem.residuals, problem.residuals.parameters
    tree = parameters.tree_of(solution.values)
    seen = data if test is None else test
    described = description and errors_as_described(problem, solution, seen)
    known = _uncertainty(problem, solution, setup)
    by_description = DescribedScale.of(problem, solution, setup, known)
    uncertainty = ladder.in_doubt(doubting(known, by_description), ladder.solution.posture)
    told = parameters.names if anew else tuple(setup.fixed)  # known before, all is told
    unplaced = unplaced_markers(data, ~solution.outliers, uncertainty, told)
    return TreeCalibration(
        tree,
        name or data.name,
        data,
        setup,
        parameters,
        solution,
        uncertainty,
        TreeErrors(residuals.observations, residuals.residuals(solution.values)),
        None if test is None else errors_of(tree, without_markers(test, unplaced)),
        cross_validate_tree(problem, solution, residuals),
        described,
        start.label,
        len(costs),
        agreeing(costs),
        time.perf_counter() - clock,
        description,
        ladder,
        unplaced=unplaced,
        anew=anew,
        late=late,
        by_description=by_description,
    )


def _uncertainty(problem: TreeProblem, solution: TreeSolution, setup: TreeSetup) -> Uncertainty:
    """Return the covariance of what was free; where nothing tells lengths, all are open as one."""
    count, names = len(solution.whitened), problem.free_names
    known = solution.variances_known
    squares = float(count - len(names) if known else solution.rest @ solution.rest)
    scales = _natural_scales(problem, solution)
    found = Uncertainty.from_jacobian(names, solution.whitened, scales, squares, count)
    if setup.scale_from is not None:
        return found
    by_scale = problem.residuals.parameters.layout.by_scale(solution.values)
    return found.doubted(by_scale[None, problem.columns])


def _natural_scales(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return the scale of each free parameter on which its sigma says whether it is known."""
    parameters, values = problem.residuals.parameters.layout, solution.values
    size = _size(parameters.tree_of(values), problem.observations.data)
    scales = parameters.scales(size, values)[problem.columns]
    bends = set(parameters.names[parameters.bends])
    held = {name: prior for name, prior in problem.priors.items() if name in bends}
    return scales_by_priors(problem.free_names, scales, held)


def _size(tree: BodyTree, data: BodyDataset) -> float:
    """Return about how far a body's markers are spread, but for those astray [m]; 0.1 at least."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    p = np.concatenate([motion.pose_of(marker)[1] for marker in tree.markers], axis=1)
    away = np.linalg.norm(p - np.median(p, axis=1, keepdims=True), axis=0)
    p = p[:, away <= _ASTRAY * (np.median(away) or np.inf)]
    return max(float(np.sqrt(np.var(p, axis=1).sum())), 0.1)
