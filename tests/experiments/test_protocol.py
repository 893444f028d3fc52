"""How simulated arms are moved for their data, and what is learned from it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import content_hash
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

ARM = ArmDescription.named("nico")
ARMS = ("right_arm", "left_arm", "neck")


def session(world="clean", protocol=None, arm=ARM, seed=0, number=0, **options):
    chosen = IMPERFECTIONS[world] if isinstance(world, str) else world
    protocol = protocol or SweepProtocol.for_arm(arm)
    return simulated_session(arm, chosen, protocol, "session", seed=seed, session=number, **options)


@pytest.mark.parametrize("name", ARMS)
def test_every_arm_of_nico_has_a_home_and_room_to_move_about_it(name):
    protocol = SweepProtocol.for_arm(ArmDescription.named("nico", name))
    assert ((protocol.home > 0.0) & (protocol.home < 1.0)).all()
    assert ((protocol.arcs > 0.1) & (protocol.arcs <= 1.0)).all()
    assert (protocol.ranges >= protocol.arcs - 1e-12).all()


def test_nicos_right_arm_bends_its_elbow_at_home():
    protocol = SweepProtocol.for_arm(ARM)
    q = ARM.lower + protocol.home * (ARM.upper - ARM.lower)
    assert np.degrees(q) == pytest.approx([-50.0, 30.0, -20.0, -75.0])
    at_home = ARM.chain.rezeroed(q)
    arms = at_home.p_WH_zero[0] - at_home.points
    radii = np.linalg.norm(np.cross(arms, at_home.directions), axis=1)
    assert radii.min() > 0.06


def test_a_session_has_home_circles_and_random_poses():
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=30)
    data = session("thesis", protocol)
    labels, counts = np.unique(data.sweep, return_counts=True)
    assert dict(zip(labels.tolist(), counts.tolist(), strict=True)) == {
        "": 30,
        "home": 4,
        **dict.fromkeys(ARM.joints, 25),
    }
    assert data.joint_names == ARM.joints
    assert data.point_sigma_m == IMPERFECTIONS["thesis"].marker_sigma
    assert data.seed == 0
    assert "thesis" in data.source
    assert session("clean", protocol).point_sigma_m is None


def test_a_sweep_moves_its_own_joint_alone_and_evenly_about_home():
    data = session()
    home = data.encoders[data.sweep == "home"][0]
    for i, joint in enumerate(ARM.joints):
        moved = data.encoders[data.sweep == joint] - home
        assert not np.delete(moved, i, axis=1).any()
        span = np.ptp(moved[:, i])
        assert moved[:, i].max() == pytest.approx(-moved[:, i].min(), rel=1e-3)
        assert np.diff(np.sort(moved[:, i])).max() < 2.1 * span / 25
        assert np.abs(moved[:, i]).min() > 0.0


def test_all_poses_lie_between_the_stops():
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=200)
    data = session(protocol=replace(protocol, ranges=np.full(4, 3.0), arcs=np.full(4, 1.5)))
    low = [joint.lower for joint in data.joints]
    high = [joint.upper for joint in data.joints]
    assert (data.encoders >= low).all()
    assert (data.encoders <= high).all()
    assert (np.ptp(data.encoders, axis=0) > 0.95 * np.subtract(high, low)).all()


def test_a_minimal_session_has_nine_samples():
    protocol = SweepProtocol.for_arm(ARM).on_share_of_arcs(0.3).minimal()
    data = session(protocol=protocol)
    assert len(data) == 9
    assert (data.sweep == "home").sum() == 1
    full = session()
    for i, joint in enumerate(ARM.joints):
        short, whole = (np.ptp(d.encoders[d.sweep == joint][:, i]) for d in (data, full))
        assert short == pytest.approx(0.3 * whole, rel=1e-3)


@pytest.mark.slow
def test_sessions_of_one_individual_are_one_body_and_other_poses():
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=20)
    first, again, second = (session("thesis", protocol, number=k) for k in (0, 0, 1))
    assert content_hash(first) == content_hash(again)
    assert np.array_equal(first.encoders[:80], second.encoders[:80])
    assert not np.array_equal(first.p_WH_measured[:80], second.p_WH_measured[:80])
    assert not np.isclose(first.encoders[-20:], second.encoders[-20:]).all(axis=1).any()
    other = session("thesis", protocol, seed=1)
    assert not np.array_equal(first.encoders[0], other.encoders[0])


def test_a_session_without_sweeps_has_random_poses_alone():
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=12)
    data = session(protocol=protocol, sweeps=False)
    assert len(data) == 12
    assert set(data.sweep.tolist()) == {""}


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_a_clean_arm_is_learned_to_the_resolution_of_its_encoders(name):
    arm = ArmDescription.named("nico", name)
    protocol = replace(SweepProtocol.for_arm(arm), random_poses=40)
    train = session("clean", protocol, arm)
    test = session("clean", protocol, arm, number=1, sweeps=False)
    # A count of the encoder at the end of a 40 cm arm.
    resolution = 0.4 * 2.0 * np.pi / IMPERFECTIONS["clean"].counts_per_turn
    for method in ("circle-points", "refine"):
        result = calibrate_kinematics(train, test=test, method=method)
        assert result.test.statistics.max < resolution
        assert judge(result).status == "PASS"


def test_what_was_not_seen_in_a_session_is_empty():
    lossy = replace(IMPERFECTIONS["clean"], dropout_share=0.4)
    chain = replace(
        ARM.chain, markers=("hand", "elbow"), p_WH_zero=np.tile(ARM.chain.p_WH_zero, (2, 1))
    )
    two = replace(ARM, chain=chain)
    data = simulated_session(two, lossy, SweepProtocol.for_arm(two), "lossy", seed=0, session=0)
    assert len(data) == 2 * 104
    lost = ~data.measured.reshape(-1, 2)
    # Both lost means another visit, so only one of the two is.
    assert not lost.all(axis=1).any()
    assert lost.mean() == pytest.approx(0.4 * 0.6 / (1.0 - 0.4**2), abs=0.08)
