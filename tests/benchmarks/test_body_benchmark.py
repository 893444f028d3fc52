"""Speed of the whole body against a named peer, in one run: 200 poses, 4 pixels, 42 parameters."""

import numpy as np
import pytest

from nico_selfmodel.estimation.body.body_initialization import body_start, lines_of
from nico_selfmodel.estimation.body.body_problem import BodyProblem
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.arm_views import AxesArm
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.model.arm.line_kinematics import hand_points
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .timing import best_ratio

pytestmark = pytest.mark.benchmark
NOISE = HandNoise(0.3, np.radians(0.29))
HELD = [f"{camera}.{name}" for camera in ("left", "right") for name in ("skew", "p1", "p2")]


@pytest.fixture(scope="module")
def problem():
    """Return the unanchored problem of chapter 8, whitened, from a start learned by stereo."""
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
    scenario = simulated_scenario(ProjectedNico.tracked_by(), world, 0, random_poses=139)
    start, dataset, _ = body_start(scenario.train, scenario.cameras, None, 0)
    observations = PixelObservations.from_dataset(dataset)
    assert len(observations) == 200
    assert observations.by_both.all()
    view = AxesArm(observations.arm, lines_of(start, ("hand",)))
    # The scale is nobody's: the baseline holds it.
    held = dict.fromkeys([*HELD, "right.pose.x"])
    built = BodyProblem(observations, view, start.rig, None, held)
    x = built.program.start
    built.hand.whiten(NOISE.whitening(built.hand.by_angle(x), observations.seen))
    return built


def ideal_in(camera, p_LH):
    """Return X/Z and Y/Z in a camera. Shape (3, N) -> (2, N)."""
    x, y, z = camera.X_CW[:3, :3] @ p_LH + camera.X_CW[:3, 3:]
    return np.stack([x / z, y / z])


def test_200_poses_and_42_parameters_beat_scipy_on_the_same_jacobian(problem, benchmark):
    from scipy.optimize import least_squares  # slow to load, and only wanted here

    program, block = problem.program, problem.hand
    free, start = np.flatnonzero(program.free), program.start
    assert len(free) == 42

    def full(y):
        x = start.copy()
        x[free] = y
        return x

    view, q_of = problem.hand.arm, problem.observations.arm.angles
    whitening = NOISE.whitening(block.by_angle(start), problem.observations.seen)

    def residuals(y):
        """As cheap as they can be: no derivatives."""
        x = full(y)
        arm = view.hypothesis(x[: len(view.names)])
        chain, q = arm.chain, np.ascontiguousarray(arm.q_of(q_of).T)
        zero = np.repeat(chain.p_WH_zero[0][:, None], q.shape[1], axis=1)
        p_LH = hand_points(chain.directions, chain.points, zero, q)
        rig = problem.rig_at(x)
        pixels = [camera.pixels_of(ideal_in(camera, p_LH)) for camera in rig.cameras]
        r = (np.concatenate(pixels) - block.measured).T
        return (whitening @ r[:, :, None])[:, :, 0].T.ravel()

    def jacobian(y):
        return block.evaluate(full(y))[1][free].reshape(len(free), -1).T

    def peer():
        return least_squares(residuals, start[free], jac=jacobian, method="lm", x_scale="jac")

    assert residuals(start[free]) == pytest.approx(block.evaluate(start)[0].ravel(), abs=1e-9)
    ours, theirs = program.solve(), peer()
    assert ours.converged
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-7)
    ratio = best_ratio(program.solve, peer)
    benchmark.extra_info["ratio_to_scipy_lm"] = ratio
    benchmark.extra_info["iterations"] = (ours.iterations, theirs.nfev)
    benchmark(program.solve)
    assert ratio <= 0.6
    assert benchmark.stats["min"] <= 60e-3
