"""The chain of lines: forward kinematics, its derivatives, and changes of zero and frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.geometry.rotation import rotation_from_vector, tangent_basis
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.line_kinematics import CarriedLines, hand_points, line_rotations

EXACT = 1e-12
SEED = st.integers(0, 2**32 - 1)
KINDS = st.lists(
    st.sampled_from(["generic", "intersecting", "parallel", "anti-parallel", "coaxial"]), max_size=6
)


def poses(chain, seed, count=5):
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (count, len(chain.joints)))


@given(kinds=KINDS, seed=SEED, markers=st.integers(1, 3))
def test_the_hand_is_where_one_turn_after_the_other_carries_it(make_chain, kinds, seed, markers):
    chain = make_chain(kinds, seed, markers)
    q = poses(chain, seed)
    for marker in range(markers):
        p = np.tile(chain.p_WH_zero[marker], (len(q), 1))
        for i in reversed(range(len(chain.joints))):
            for k in range(len(q)):
                turn = rotation_from_vector(q[k, i] * chain.directions[i])
                p[k] = chain.points[i] + turn @ (p[k] - chain.points[i])
        assert chain.forward(q, marker) == pytest.approx(p, abs=EXACT)
        assert chain.forward(q[0], marker) == pytest.approx(p[0], abs=EXACT)
    assert chain.forward(np.zeros(len(chain.joints))) == pytest.approx(chain.p_WH_zero[0])


def test_each_pose_may_watch_another_marker(make_chain):
    chain = make_chain(["generic"] * 3, 1, markers=3)
    q, marker = poses(chain, 2, 6), np.array([0, 2, 1, 1, 0, 2])
    expected = [chain.forward(a, m) for a, m in zip(q, marker, strict=True)]
    assert chain.forward(q, marker) == pytest.approx(np.array(expected), abs=1e-15)


@given(kinds=KINDS, seed=SEED)
def test_link_motions_carry_the_hand_and_every_axis(make_chain, kinds, seed):
    chain = make_chain(kinds, seed)
    q = poses(chain, seed)[0]
    motions = chain.link_motions(q)
    assert motions.shape == (len(chain.joints) + 1, 4, 4)
    assert np.array_equal(motions[0], np.eye(4))
    assert apply(motions[-1], chain.p_WH_zero[0]) == pytest.approx(chain.forward(q), abs=EXACT)
    # a point of axis i is fixed to both links that the axis joins
    before, after = apply(motions[:-1], chain.points), apply(motions[1:], chain.points)
    assert before == pytest.approx(after, abs=EXACT)


@given(kinds=KINDS, seed=SEED, markers=st.integers(1, 2))
def test_another_zero_is_the_same_arm(make_chain, kinds, seed, markers):
    chain = make_chain(kinds, seed, markers)
    zero, *q = poses(chain, seed, 4)
    for marker in range(markers):
        found = chain.rezeroed(zero).forward(np.array(q), marker)
        assert found == pytest.approx(chain.forward(np.array(q) + zero, marker), abs=EXACT)


@given(kinds=KINDS, seed=SEED)
def test_another_frame_is_the_same_arm(make_chain, kinds, seed):
    chain = make_chain(kinds, seed, 2)
    rng = np.random.default_rng(seed)
    x_NW = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    q = poses(chain, seed)
    assert chain.moved(x_NW).forward(q, 1) == pytest.approx(
        apply(x_NW, chain.forward(q, 1)), abs=EXACT
    )


@pytest.mark.parametrize("kinds", [[], ["generic"] * 5, ["parallel", "coaxial", "intersecting"]])
def test_the_derivatives_in_the_line_view_are_those_of_central_differences(make_chain, kinds):
    chain = make_chain(kinds, 7, markers=2)
    q = poses(chain, 8, 4).T
    p_zero = chain.p_WH_zero[[0, 1, 1, 0]].T
    basis = tangent_basis(chain.directions)
    lines = CarriedLines.at(chain.directions, q, basis, basis)
    d = lines.derivatives(chain.points, p_zero)
    n, h = len(chain.joints), 1e-6
    assert d.p == pytest.approx(hand_points(chain.directions, chain.points, p_zero, q), abs=1e-14)

    def slope(move):
        return (hand_points(*move(h)) - hand_points(*move(-h))) / (2.0 * h)

    def turned(i, b):
        axis = np.cross(chain.directions[i], b)
        return lambda t: (
            np.where(
                np.arange(n)[:, None] == i,
                rotation_from_vector(t * axis) @ chain.directions[i],
                chain.directions,
            ),
            chain.points,
            p_zero,
            q,
        )

    for i in range(n):
        one = np.arange(n)[:, None] == i
        by_angle = slope(lambda t, one=one: (chain.directions, chain.points, p_zero, q + t * one))
        assert d.by_angle[:, i] == pytest.approx(by_angle, abs=1e-8)
        for k in range(2):
            b = basis[i, :, k]
            by_point = slope(
                lambda t, one=one, b=b: (chain.directions, chain.points + t * one * b, p_zero, q)
            )
            assert d.by_point[:, i, k] == pytest.approx(by_point, abs=1e-8)
            assert d.by_direction[:, i, k] == pytest.approx(slope(turned(i, b)), abs=1e-8)
    for k, e in enumerate(np.eye(3)):
        by_hand = slope(lambda t, e=e: (chain.directions, chain.points, p_zero + t * e[:, None], q))
        assert d.by_hand[:, k] == pytest.approx(by_hand, abs=1e-8)


def test_many_chains_at_once_have_the_derivatives_of_each(make_chain):
    chains = [make_chain(["generic"] * 3, seed, markers=1) for seed in (1, 2)]
    q = np.stack([poses(chain, 5, 4).T for chain in chains])
    directions, points = (
        np.stack([getattr(c, k) for c in chains]) for k in ("directions", "points")
    )
    p_zero = np.stack([np.tile(chain.p_WH_zero[0][:, None], 4) for chain in chains])
    basis = tangent_basis(directions)
    together = CarriedLines.at(directions, q, basis, basis).derivatives(points, p_zero)
    for k in range(2):
        lines = CarriedLines.at(directions[k], q[k], basis[k], basis[k])
        alone = lines.derivatives(points[k], p_zero[k])
        for part in ("p", "by_direction", "by_point", "by_angle", "by_hand"):
            found = getattr(together, part)[:, k]
            assert found == pytest.approx(getattr(alone, part), abs=1e-14), part


def test_line_rotations_are_rodrigues(make_chain):
    chain = make_chain(["generic"] * 2, 3)
    q = poses(chain, 4, 5).T
    found = line_rotations(chain.directions, q)
    for i in range(3):
        for k in range(5):
            expected = rotation_from_vector(q[i, k] * chain.directions[i])
            assert found[i, :, :, k] == pytest.approx(expected, abs=1e-14)


def test_a_chain_cannot_be_changed_by_anyone(make_chain):
    chain = make_chain(["generic"], 1)
    mine = np.array(chain.points)
    copy = Chain(chain.joints, chain.directions, mine, chain.markers, chain.p_WH_zero)
    mine[0] = 99.0
    assert np.array_equal(copy.points, chain.points)
    with pytest.raises(ValueError, match="read-only"):
        copy.points[0] = 1.0
    with pytest.raises(AttributeError):
        copy.points = mine


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"directions": [[0.0, 0.0, 2.0]]}, "unit length"),
        ({"directions": [[0.0, 0.0, np.nan]]}, "directions must be finite"),
        ({"points": [[0.0, 0.0]]}, r"points must have shape \(1, 3\), got \(1, 2\)"),
        ({"markers": ("a", "a"), "p_WH_zero": np.zeros((2, 3))}, "names must be unique"),
        ({"markers": (), "p_WH_zero": np.zeros((0, 3))}, "at least one"),
    ],
)
def test_a_chain_that_is_none_is_refused(change, message):
    good = {
        "joints": ("a",),
        "directions": [[0.0, 0.0, 1.0]],
        "points": [[0.0, 0.0, 0.0]],
        "markers": ("hand",),
        "p_WH_zero": [[0.1, 0.0, 0.0]],
    }
    Chain(**good)
    with pytest.raises(ValueError, match=message):
        Chain(**{**good, **change})


def test_wrong_questions_are_answered_with_what_there_is(make_chain):
    chain = make_chain(["generic"], 1, markers=2)
    assert chain.marker_index("marker_1") == 1
    with pytest.raises(ValueError, match="no marker 'thumb'; there are marker_0, marker_1"):
        chain.marker_index("thumb")
    with pytest.raises(ValueError, match=r"q must have shape \(N, 2\), got \(4, 3\)"):
        chain.forward(np.zeros((4, 3)))
