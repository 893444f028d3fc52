"""Chapter 6 of the thesis, simulated: every row beside the published figure."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.experiments import motion_capture
from nico_selfmodel.experiments.motion_capture import (
    FEW,
    MANY,
    THESIS_MM,
    THESIS_REPEATS,
    joined,
    link_lengths_mm,
    run_motion_capture,
)
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

ARM = ArmDescription.named("nico")


@pytest.fixture(scope="module")
def small():
    """Return the experiment with one individual and two repeats, and its progress."""
    steps = []
    patch = pytest.MonkeyPatch()
    patch.setattr(motion_capture, "RANDOM_POSES", (0, 50, 100))
    results = run_motion_capture(
        ARM,
        IMPERFECTIONS["thesis"],
        individuals=1,
        repeats=2,
        seed=0,
        progress=lambda *step: steps.append(step),
    )
    patch.undo()
    return results, steps


@pytest.mark.slow
def test_every_condition_has_a_row_with_the_thesis_beside_it(small):
    results, _ = small
    rows = {(r.circle_samples, r.method, r.random_samples): r for r in results.rows}
    assert len(rows) == len(results.rows) == 2 + 2 * 3
    for condition, row in rows.items():
        assert row.thesis_mm == THESIS_MM.get(condition)
        assert 0.0 < row.mean_mm <= row.worst_mm
        assert row.sd_mm > 0.0
        assert row.seconds > 0.0
    assert (results.world, results.individuals) == ("thesis", 1)


@pytest.mark.slow
def test_refinement_and_random_poses_help_as_in_the_thesis(small):
    rows = {(r.circle_samples, r.method, r.random_samples): r.mean_mm for r in small[0].rows}
    assert rows[MANY, "refined", 0] < 1.2 * rows[MANY, "circle points", 0]
    assert rows[MANY, "circle points", 0] < rows[FEW, "circle points", 0]
    for samples in (FEW, MANY):
        assert rows[samples, "refined", 100] < 4.0
        assert rows[samples, "refined", 100] < 0.8 * rows[samples, "refined", 0]


@pytest.mark.slow
def test_progress_counts_robots_and_repeats(small):
    _, steps = small
    charts = [step[1:] for step in steps if step[0] == "charts"]
    assert charts == [(0, 1), (1, 1)]
    assert [step[1:] for step in steps if step[0] == "repeats"] == [(0, 2), (1, 2)]


@pytest.mark.slow
def test_the_links_are_those_of_the_robot(small):
    results, _ = small
    q = ARM.lower + 0.5 * (ARM.upper - ARM.lower)
    at = ARM.chain.rezeroed(q)
    upper = 1e3 * np.linalg.norm(at.points[3] - at.points[0])
    for (mean, sd), nominal in zip(results.repeats.links_mm, (upper, None), strict=True):
        assert sd < 2.0
        # An individual's links differ from the description by millimetres.
        assert nominal is None or mean == pytest.approx(nominal, abs=10.0)


@pytest.mark.slow
def test_links_are_learned_to_a_micrometre_where_nothing_is_noisy():
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=20)
    perfect = replace(IMPERFECTIONS["clean"], link_sigma=0.0, axis_sigma=0.0)
    data = simulated_session(ARM, perfect, protocol, "clean", seed=2, session=0)
    upper, forearm = link_lengths_mm(calibrate_kinematics(data))
    chain = ARM.chain
    elbow = chain.points[3]
    assert upper == pytest.approx(130.0, abs=1e-3)
    assert forearm == pytest.approx(1e3 * np.linalg.norm(chain.p_WH_zero[0] - elbow), abs=1e-3)


def test_joined_sessions_keep_every_row_and_number_on():
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=10)
    first = simulated_session(ARM, IMPERFECTIONS["thesis"], protocol, "a", seed=0, session=0)
    second = simulated_session(
        ARM, IMPERFECTIONS["thesis"], protocol, "b", seed=0, session=1, sweeps=False
    )
    both = joined(first, second)
    assert len(both) == len(first) + len(second)
    assert np.unique(both.sample).size == np.unique(first.sample).size + 10
    assert np.array_equal(both.encoders[-10:], second.encoders)
    assert np.array_equal(both.p_WH_measured[: len(first)], first.p_WH_measured, equal_nan=True)
    assert both.sweep[: len(first)].tolist() == first.sweep.tolist()


@pytest.mark.slow
def test_every_row_is_within_a_factor_of_two_of_the_thesis_or_better():
    results = run_motion_capture(ARM, IMPERFECTIONS["thesis"], individuals=3, repeats=10)
    assert {row.random_samples for row in results.rows} == {0, 50, 100, 500}
    for row in results.rows:
        if row.thesis_mm is not None:
            assert row.mean_mm <= 2.0 * row.thesis_mm[0], row
            assert row.sd_mm <= 2.0 * row.thesis_mm[1], row
    for name in ("train", "test"):
        mean, sd = getattr(results.repeats, f"{name}_mm")
        assert mean <= 2.0 * THESIS_REPEATS[name][0]
        assert sd <= 2.0 * THESIS_REPEATS[name][1]
    assert all(sd <= 1.0 for _, sd in results.repeats.links_mm)
