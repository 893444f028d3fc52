"""Speed of the whole body against a named peer, in one run: 200 poses, 4 pixels, 42 parameters."""

import numpy as np
import pytest

from nico_selfmodel.estimation.body.arm_parameters import arm_tree
from nico_selfmodel.estimation.body.body_initialization import body_start, lines_of, named_like
from nico_selfmodel.estimation.body.seen_body import SeenBody
from nico_selfmodel.estimation.observations.observations import gears_known
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.noise.noise_evidence import tree_whitening
from nico_selfmodel.estimation.tree.tree_block import TreeBlock
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import blank_body
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .timing import best_ratio

pytestmark = pytest.mark.benchmark
NOISE = TreeNoise(np.array([0.3]), np.full(4, np.radians(0.29)))
HELD = {f"{camera}.{name}" for camera in SIDES for name in ("skew", "p1", "p2")}


@pytest.fixture(scope="module")
def problem():
    """Return the unanchored problem of chapter 8, about a start learned by stereo."""
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
    scenario = simulated_scenario(ProjectedNico.tracked_by(), world, 0, random_poses=139)
    start, dataset, _ = body_start(scenario.train, scenario.cameras, None, 0)
    observations = PixelObservations.from_dataset(dataset)
    assert len(observations) == 200
    assert observations.by_both.all()
    seen = SeenBody.of(observations, dataset, None)
    arm = named_like(lines_of(start, ("hand",)), start, gears_known(observations.arm.units))
    like = blank_body(seen.data, dict(zip(SIDES, start.rig.cameras, strict=True)))
    parameters = TreeParameters(arm_tree(arm, start.rig, like))
    joints = parameters.base.joints
    free = {name for joint in joints for name in (*parameters.line_of(joint), f"{joint}.gear")}
    free |= {f"hand.hand.{part}" for part in SHIFTS}
    free |= {name.replace(".pose.", ".") for name in start.rig.names} - HELD
    # The scale is nobody's: the baseline holds it.
    free -= {"right.x"}
    residuals = TreeResiduals(TreeObservations.of(seen.data), parameters)
    return TreeProblem(residuals, frozenset(free), {}, NOISE), parameters.start


def test_200_poses_and_42_parameters_beat_scipy_on_the_same_jacobian(problem, benchmark):
    from scipy.optimize import least_squares  # slow to load, and only wanted here

    tree, values = problem
    assert len(tree.free_names) == 42
    nothing = np.zeros(len(tree.observations.data.observations), dtype=bool)
    groups = tree.observations.groups(nothing)
    seen, linear = tree.observations, tree.linear_at(values, None)
    whitening = tree_whitening(seen, linear, groups, tree.noise)
    program = tree.program(values, whitening)
    start = program.start

    def linear_at(y):
        x = values.copy()
        x[tree.columns] = y
        return tree.linear_at(x, None)

    free = (tree.free_names, tree.columns)
    block = TreeBlock(seen, free, linear_at, tree.scale, whitening)

    def residuals(y):
        """As cheap as they can be: no derivatives."""
        x = values.copy()
        x[tree.columns] = y
        r = (tree.residuals.residuals(x) / tree.scale)[None]
        return whitening.whiten(r, np.zeros((0, *r.shape)))[0].ravel()

    def jacobian(y):
        return block.evaluate(y)[1].reshape(len(y), -1).T

    def peer():
        return least_squares(residuals, start, jac=jacobian, method="lm", x_scale="jac")

    ours, theirs = program.solve(), peer()
    assert residuals(start) == pytest.approx(block.evaluate(start)[0].ravel(), abs=1e-9)
    assert ours.converged
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-7)
    ratio = best_ratio(program.solve, peer)
    benchmark.extra_info["ratio_to_scipy_lm"] = ratio
    benchmark.extra_info["iterations"] = (ours.iterations, theirs.nfev)
    benchmark(program.solve)
    assert ratio <= 0.6
    assert benchmark.stats["min"] <= 60e-3
