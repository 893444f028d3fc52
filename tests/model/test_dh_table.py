"""Lines -> rows -> lines, for axes in every position."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from nico_selfmodel.geometry.rotation import rotation_about, tangent_basis
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable

EXACT = 1e-12
SEED = st.integers(0, 2**32 - 1)
KINDS = st.lists(
    st.sampled_from(
        [
            "generic",
            "intersecting",
            "parallel",
            "anti-parallel",
            "near-parallel",
            "coaxial",
            "near-coaxial",
        ]
    ),
    max_size=6,
)
ROWS = ("D", "theta_zero", "r", "alpha", "beta")


def assert_same_arm(chain, other, tolerance):
    assert chain.joints == other.joints
    assert chain.markers == other.markers
    assert other.directions == pytest.approx(chain.directions, abs=tolerance)
    assert other.p_WH_zero == pytest.approx(chain.p_WH_zero, abs=tolerance)
    for i, (point, direction) in enumerate(zip(chain.points, chain.directions, strict=True)):
        assert np.linalg.norm(np.cross(other.points[i] - point, direction)) < tolerance


def differences(table, other):
    """Return the largest differences of rows, in m and rad; angles modulo a turn."""
    rows = [getattr(table, name) - getattr(other, name) for name in ROWS]
    angles = [np.abs(np.angle(np.exp(1j * rows[k]))).max() for k in (1, 3, 4)]
    return max(angles + [np.abs(rows[k]).max() for k in (0, 2)])


@given(kinds=KINDS, seed=SEED, markers=st.integers(1, 3), hand_on_axis=st.booleans())
@example(kinds=["parallel"] * 6, seed=1, markers=2, hand_on_axis=False)
@example(kinds=["coaxial"] * 3, seed=2, markers=1, hand_on_axis=True)
@example(kinds=["generic", "parallel", "parallel", "generic"], seed=3, markers=1, hand_on_axis=True)
def test_a_chain_survives_the_way_to_rows_and_back(make_chain, kinds, seed, markers, hand_on_axis):
    chain = make_chain(kinds, seed, markers, hand_on_axis)
    table = DhTable.from_chain(chain)
    rotation = table.X_W0[:3, :3]
    assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=EXACT)
    assert_same_arm(chain, table.to_chain(), EXACT)
    q = np.random.default_rng(seed).uniform(-3.0, 3.0, (4, len(chain.joints)))
    for marker in range(markers):
        expected = chain.forward(q, marker)
        assert table.forward(q, marker) == pytest.approx(expected, abs=EXACT)
        assert table.to_chain().forward(q, marker) == pytest.approx(expected, abs=EXACT)


@pytest.mark.parametrize("gap", [0.0, 1e-13, 1e-11, 1e-9, 1e-6])
@pytest.mark.parametrize("place", ["first axes", "last axes", "hand"])
def test_what_lies_almost_on_an_axis_costs_no_accuracy(make_chain, gap, place):
    kinds = {"first axes": ["coaxial", "generic"], "last axes": ["generic", "coaxial"], "hand": []}
    for seed in range(10):
        chain = make_chain(kinds[place], seed, 2, hand_on_axis=place == "hand")
        points, hands = chain.points.copy(), chain.p_WH_zero.copy()
        aside = gap * tangent_basis(chain.directions[-1])[:, 0]
        if place == "hand":
            hands[0] += aside
        else:
            points[1 if place == "first axes" else 2] += aside
        chain = dataclasses.replace(chain, points=points, p_WH_zero=hands)
        table = DhTable.from_chain(chain)
        rotation = table.X_W0[:3, :3]
        assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=EXACT)
        assert_same_arm(chain, table.to_chain(), EXACT)


@given(kinds=KINDS, seed=SEED)
def test_the_tables_made_here_pin_what_points_cannot_tell(make_chain, kinds, seed):
    table = DhTable.from_chain(make_chain(kinds, seed, 2))
    assert (table.D[0], table.theta_zero[0], table.alpha[-1], table.beta[-1]) == (0, 0, 0, 0)
    assert table.p_NH[0].tolist() == [0.0, 0.0, 0.0]
    assert np.all(table.beta[~table.parallel] == 0.0)
    assert np.abs(table.D[table.fixed_D]).max() == 0.0
    ordinary = ~table.parallel
    ordinary[-1] = False
    assert np.all((table.alpha[ordinary] > 0.0) & (table.alpha[ordinary] < np.pi))
    assert np.all(table.r[~ordinary] >= -EXACT)


def test_rows_are_the_thesis_own():
    # A planar arm: 0.13 m, then 0.127 m after a quarter turn of the second axis about x.
    chain = Chain(
        ("a", "b"),
        np.array([[0, 0, 1.0], [0, -1.0, 0]]),
        np.array([[0, 0, 0.5], [0.13, 0, 0.5]]),
        ("hand",),
        np.array([[0.257, 0.0, 0.5]]),
    )
    table = DhTable.from_chain(chain)
    assert table.X_W0[:3, 3] == pytest.approx([0.0, 0.0, 0.5])
    assert table.r == pytest.approx([0.13, 0.127])
    assert table.alpha == pytest.approx([0.5 * np.pi, 0.0])
    for name in ("D", "theta_zero", "beta"):
        assert getattr(table, name) == pytest.approx([0.0, 0.0], abs=1e-15)
    frames = table.frames([np.pi / 2, 0.0])
    assert frames[1, :3, 3] == pytest.approx([0.0, 0.13, 0.5])
    moved = table.joint_motions([np.pi / 2, 0.0])
    assert frames[1] == pytest.approx(frames[0] @ moved[0] @ table.links[0])
    assert table.frames(np.zeros((5, 2))).shape == (3, 5, 4, 4)


@pytest.mark.parametrize("angle_deg", [30.0, 90.0, 150.0])
def test_noise_does_not_decide_the_sign_of_a_normal_between_axes_that_meet(angle_deg):
    d = np.array([[0, 0, 1.0], rotation_about([1.0, 0, 0], np.radians(angle_deg)) @ [0, 0, 1.0]])
    d = np.vstack([d, [1.0, 0.0, 0.0]])
    tables = []
    for off in (-1e-6, 0.0, 1e-6):
        points = np.array([[0, 0, 0], [off, 0, 0.02], [0.2, 0.1, 0.0]])
        chain = Chain(("a", "b", "c"), d, points, ("hand",), np.array([[0.3, 0.1, 0.2]]))
        tables.append(DhTable.from_chain(chain))
    assert [table.r[0] for table in tables] == pytest.approx([-1e-6, 0.0, 1e-6], abs=1e-12)
    assert differences(tables[0], tables[1]) < 2e-5
    assert differences(tables[2], tables[1]) < 2e-5


@given(seed=SEED, flips=st.lists(st.booleans(), min_size=5, max_size=5))
def test_a_table_of_other_signs_and_gauge_is_followed_number_by_number(make_chain, seed, flips):
    kinds = ["generic", "intersecting", "parallel", "generic"]
    plain = DhTable.from_chain(make_chain(kinds, seed, 2))
    # x_i turned round: theta_i + pi, -r_i, -alpha_i, -beta_i, theta_{i+1} + pi
    side = np.where(flips, -1.0, 1.0)
    theta = plain.theta_zero + np.pi * np.array(flips)
    theta[1:] += np.pi * np.array(flips[:-1])
    last = np.array([side[-1], side[-1], 1.0])
    flipped = dataclasses.replace(
        plain,
        theta_zero=theta,
        r=plain.r * side,
        alpha=plain.alpha * side,
        beta=plain.beta * side,
        p_NH=plain.p_NH * last,
    )
    assert_same_arm(plain.to_chain(), flipped.to_chain(), 1e-11)
    followed = DhTable.from_chain(flipped.to_chain(), like=flipped)
    assert differences(followed, flipped) < 1e-8
    pose = followed.X_W0
    assert pose == pytest.approx(flipped.X_W0, abs=1e-9)
    assert followed.p_NH == pytest.approx(flipped.p_NH, abs=1e-9)


@given(kinds=KINDS, seed=SEED, hand_on_axis=st.booleans())
@example(kinds=["generic", "coaxial"], seed=5, hand_on_axis=False)
@example(kinds=["generic"], seed=3, hand_on_axis=True)
def test_a_table_that_follows_itself_is_itself(make_chain, kinds, seed, hand_on_axis):
    chain = make_chain(kinds, seed, 2, hand_on_axis)
    table = DhTable.from_chain(chain)
    followed = DhTable.from_chain(chain, like=table)
    assert differences(followed, table) < 1e-12
    assert followed.p_NH == pytest.approx(table.p_NH, abs=1e-12)


@pytest.mark.parametrize("like_deg", [None, 0.1, 6.5, 10.0])
@pytest.mark.parametrize(
    ("tilt_deg", "hayati"), [(0.0, True), (1e-6, True), (0.09, True), (4.9, True), (5.1, False)]
)
def test_rows_between_nearly_parallel_axes_are_hayatis_whatever_table_is_followed(
    tilt_deg, hayati, like_deg
):
    def chain(tilt_deg):
        tilt = np.radians(tilt_deg)
        directions = np.array([[0, 0, 1], [0, np.sin(tilt), np.cos(tilt)], [1, 0, 0]])
        points = np.array([[0, 0, 0], [0.3, 0, 0.1], [0.5, 0.2, 0.1]])
        return Chain(("a", "b", "c"), directions, points, ("hand",), np.array([[0.7, 0.1, 0.2]]))

    like = None if like_deg is None else DhTable.from_chain(chain(like_deg))
    table = DhTable.from_chain(chain(tilt_deg), like)
    assert table.parallel.tolist() == [hayati, False, False]
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3))
    assert table.forward(q) == pytest.approx(chain(tilt_deg).forward(q), abs=1e-12)
    # The feet of a common normal would lie as far away as the axes are from parallel.
    assert np.abs([*table.D, *table.r]).max() < 6.0


def test_a_gauge_of_ones_own_is_followed(make_chain):
    chain = make_chain(["generic"] * 3, 4)
    plain = DhTable.from_chain(chain)
    first = np.array([1.0, 0.0, 0.0, 0.0])
    own = dataclasses.replace(
        plain, D=plain.D + 0.3 * first, theta_zero=plain.theta_zero + 0.7 * first
    )
    followed = DhTable.from_chain(chain, like=own)
    assert (followed.D[0], followed.theta_zero[0]) == (own.D[0], own.theta_zero[0])
    assert_same_arm(chain, followed.to_chain(), EXACT)


def test_a_table_cannot_be_changed_and_checks_its_shapes(make_chain):
    table = DhTable.from_chain(make_chain(["generic"], 1))
    with pytest.raises(ValueError, match="read-only"):
        table.D[0] = 1.0
    with pytest.raises(ValueError, match=r"r must have shape \(2,\), got \(3,\)"):
        dataclasses.replace(table, r=np.zeros(3))
    with pytest.raises(ValueError, match="alpha must be finite"):
        dataclasses.replace(table, alpha=[np.nan, 0.0])
