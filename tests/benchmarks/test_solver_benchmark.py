"""Speed against named peers, in one run: 604 poses and 23 parameters, and 104 circle points."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematic_task import sweeps_of
from nico_selfmodel.estimation.initialization.circle_points import analyse_circle_points
from nico_selfmodel.estimation.initialization.start_search import line_program
from nico_selfmodel.estimation.observations.observations import Observations, gears_known
from nico_selfmodel.model.arm.line_kinematics import hand_points
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .timing import best_ratio

pytestmark = pytest.mark.benchmark
SIGMA = 1e-3


@pytest.fixture(scope="module")
def problem():
    arm = ArmDescription.named("nico")
    world = IMPERFECTIONS["clean"].with_noise(play_deg=0.5, marker_mm=0.5)
    poses = replace(SweepProtocol.for_arm(arm), random_poses=500)
    data = simulated_session(arm, world, poses, "604 poses", seed=0, session=0)
    observations = Observations.from_dataset(data)
    circles = data.select(data.sweep != "")
    on_circles = Observations.from_dataset(circles)
    assert len(observations) == 604
    assert len(on_circles) == 104
    sweeps = sweeps_of(circles, on_circles)
    known = gears_known(on_circles.units)

    def analyse():
        return analyse_circle_points(on_circles, sweeps, known, np.random.default_rng(0))

    return observations, analyse


def scipy_peer(block, observations, start):
    """Return scipy's `lm` with our Jacobian, its residuals alone being as cheap as they can be."""
    from scipy.optimize import least_squares  # slow to load, and only wanted here

    marker, measured = observations.marker, observations.p_WH.T

    def residuals(x):
        arm = block.hypothesis(x)
        q = np.ascontiguousarray(arm.q_of(observations.angles).T)
        chain = arm.chain
        p = hand_points(chain.directions, chain.points, chain.p_WH_zero[marker].T, q)
        return ((p - measured) / SIGMA).ravel()

    def jacobian(x):
        return block.evaluate(x)[1].reshape(len(x), -1).T

    return lambda: least_squares(residuals, start, jac=jacobian, method="lm")


def test_refining_604_poses_takes_half_of_scipys_time_and_reaches_its_minimum(problem, benchmark):
    observations, analyse = problem
    program, block = line_program(observations, analyse().arm, np.zeros(4, dtype=bool), SIGMA)
    assert int(program.free.sum()) == 23
    peer = scipy_peer(block, observations, block.start)
    ours, theirs = program.solve(), peer()
    assert ours.cost == pytest.approx(theirs.cost, rel=1e-8)
    ratio = best_ratio(program.solve, peer)
    benchmark.extra_info["ratio_to_scipy_lm"] = ratio
    benchmark(program.solve)
    assert ratio <= 0.5
    assert benchmark.stats["min"] <= 20e-3


def test_circle_point_analysis_of_104_points_takes_at_most_20_ms(problem, benchmark):
    _, analyse = problem
    assert analyse().arm is not None
    benchmark(analyse)
    assert benchmark.stats["min"] <= 20e-3
