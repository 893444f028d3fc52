import numpy as np
import pytest

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.link_lengths import link_lengths

PAIRED = Chain(
    ("pitch", "roll", "twist", "elbow"),
    np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 0.3, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, -0.13]]),
    ("hand", "tip"),
    np.array([[0.0, 0.0, -0.257], [0.03, 0.0, -0.3]]),
)


def crooked():
    rng = np.random.default_rng(4)
    directions = PAIRED.directions + 0.03 * rng.normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = PAIRED.points + 0.003 * rng.normal(size=(4, 3))
    return Chain(PAIRED.joints, directions, points, PAIRED.markers, PAIRED.p_WH_zero)


def test_the_lengths_of_a_paired_arm_are_those_between_its_crossings():
    assert link_lengths(PAIRED) == pytest.approx((0.13, 0.127))
    assert link_lengths(PAIRED, 1)[1] == pytest.approx(np.hypot(0.03, 0.17))


def test_neither_pose_nor_place_nor_the_choice_of_points_changes_them():
    arm = crooked()
    lengths = link_lengths(arm)
    assert lengths != pytest.approx(link_lengths(PAIRED), abs=1e-5)
    for q in np.random.default_rng(1).uniform(-2.0, 2.0, (5, 4)):
        assert link_lengths(arm.rezeroed(q)) == pytest.approx(lengths, abs=1e-12)
    moved = arm.moved(transform(rotation_from_vector([0.3, 1.0, -2.0]), [1.0, 2.0, 3.0]))
    assert link_lengths(moved) == pytest.approx(lengths, abs=1e-12)
    along = Chain(
        arm.joints, arm.directions, arm.points + 0.2 * arm.directions, arm.markers, arm.p_WH_zero
    )
    assert link_lengths(along) == pytest.approx(lengths, abs=1e-12)


def test_an_arm_that_is_not_paired_has_none():
    with pytest.raises(ValueError, match="4 joints has two links, got 3"):
        link_lengths(
            Chain(("a", "b", "c"), PAIRED.directions[:3], PAIRED.points[:3], ("h",), [[0, 0, 1.0]])
        )
    straight = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    with pytest.raises(ValueError, match="parallel"):
        link_lengths(Chain(PAIRED.joints, straight, PAIRED.points, ("h",), [[0, 0, 1.0]]))
