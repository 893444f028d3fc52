"""What loose joints of an arm leave open of where it is seen in a mirror, and of marks on it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.body_alignment import BodyMotion
from nico_selfmodel.estimation.mirrors.mark_place import (
    NOT_ON_ME,
    ON_ME,
    PosedBody,
    Spot,
    seen_once,
    spot_of,
)
from nico_selfmodel.estimation.mirrors.reflection_sigma import LooseParts, reflection_sigma
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.solids.solid import Solid, onto_solids
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.sessions.looks.finding import Finding, told_once
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

LEFT, RIGHT = (camera.at(np.eye(4)) for camera in NICO_CAMERAS.cameras)
RIG = StereoRig(LEFT, RIGHT.at(transform(np.eye(3), [0.07, 0.0, 0.0])))
MIRROR = Mirror.from_values([0.05, -0.1, 0.3])
X_WA = transform(np.eye(3), [0.0, 0.16, -0.05])
ELBOW = np.array([0.1, 0.3, -0.05])
JOINTS = [
    (BodyMotion(np.array([0.0, 0.0, 1.0]), ELBOW), frozenset({"arm"})),
    (BodyMotion(np.array([1.0, 0.0, 0.0]), ELBOW), frozenset({"arm", "hand"})),
]
LOOSE = np.array([[1e-5, 4e-6], [4e-6, 2e-5]])
"""Of the joints [rad^2]."""


def turned(p_W, turns):
    """Return where points are once both joints have turned."""
    for (motion, _), turn in zip(JOINTS, turns, strict=True):
        p_W = ELBOW + (p_W - ELBOW) @ rotation_from_vector(turn * motion.direction).T
    return p_W


def test_loose_joints_spread_a_reflection_as_is_said():
    p_W = np.array([[0.02, 0.18, 0.0]])
    rig, rng = MirrorRig(RIG, MIRROR), np.random.default_rng(3)
    u, v = np.rint(rig.project(p_W)[0, :2]).astype(int)
    depth = np.full((480, 640), np.inf)
    depth[v, u] = apply(LEFT.X_CW, reflect(rig.plane, p_W))[0, 2]
    moved = np.zeros((2, *depth.shape), dtype=bool)
    moved[:, v, u] = True
    motions = [motion for motion, _ in JOINTS]
    sigma = reflection_sigma(RIG, MIRROR, 0, depth, 0.0, LooseParts(motions, moved, LOOSE))[v, u]
    turns = rng.multivariate_normal(np.zeros(2), LOOSE, 1000)
    pixels = np.array([rig.project(turned(p_W, turn))[0, :2] for turn in turns])
    scatter = np.sqrt(0.5 * np.trace(np.cov(pixels.T)))
    # Rounded up to a sixteenth of a pixel.
    assert 0.93 * scatter < sigma < 1.07 * scatter + 0.0625
    moved[1] = False
    less = reflection_sigma(RIG, MIRROR, 0, depth, 0.0, LooseParts(motions, moved, LOOSE))[v, u]
    assert less < sigma
    moved[0] = False
    none = reflection_sigma(RIG, MIRROR, 0, depth, 0.0, LooseParts(motions, moved, LOOSE))
    assert np.array_equal(none, reflection_sigma(RIG, MIRROR, 0, depth, 0.0), equal_nan=True)


def arm(loose=(), covariance=None):
    """Return an arm that is a ball on loose joints."""
    solid = Solid("ellipsoid", (0.06, 0.06, 0.06), X_WA)
    return PosedBody(
        [solid], ["arm"], {"arm": X_WA}, [], np.diag(np.full(3, 1e-12)), {"arm": 1e-5},
        loose, np.zeros((0, 0)) if covariance is None else covariance,
    )  # fmt: skip


@pytest.mark.slow
def test_a_mark_on_a_loose_arm_is_as_exactly_placed_as_is_said():
    rng, rig = np.random.default_rng(5), MirrorRig(RIG, MIRROR)
    known, sigma, chi = arm(JOINTS, LOOSE), 0.05, []
    p_WC = reflect(rig.plane, LEFT.X_WC[:3, 3])
    for _ in range(200):
        aim = X_WA[:3, 3] + 0.03 * rng.standard_normal(3)
        way = (aim - p_WC) / np.linalg.norm(aim - p_WC)
        p_W = onto_solids(known.solids, p_WC[None], way[None])
        if not np.isfinite(p_W).all():
            continue
        turns = rng.multivariate_normal(np.zeros(2), LOOSE)
        pixels = rig.project(turned(p_W, turns))[0] + 0.05 * rng.standard_normal(4)
        spot = spot_of(pixels, sigma, RIG, MIRROR, known)
        if spot is None or spot.kind != ON_ME:
            continue
        off = spot.place.p_FM - (p_W[0] - X_WA[:3, 3])
        chi.append(off @ np.linalg.pinv(spot.place.own + spot.place.common, 1e-6) @ off)
    assert len(chi) > 120
    assert 0.75 < np.mean(chi) / 2.0 < 1.25


def test_what_joints_leave_open_is_of_one_look_alone():
    rig = MirrorRig(RIG, MIRROR)
    known, firm = arm(JOINTS, LOOSE), arm()
    p_WC = reflect(rig.plane, LEFT.X_WC[:3, 3])
    way = X_WA[:3, 3] - p_WC
    p_W = onto_solids(known.solids, p_WC[None], way[None] / np.linalg.norm(way))
    loose, held = (
        spot_of(rig.project(p_W)[0], 0.05, RIG, MIRROR, body).place for body in (known, firm)
    )
    np.testing.assert_allclose(loose.own - loose.loose, held.own, atol=1e-12)
    np.testing.assert_allclose(loose.in_part - loose.loose, held.in_part, atol=1e-12)
    np.testing.assert_allclose(loose.common, held.common, atol=1e-12)
    assert np.sqrt(np.trace(loose.loose)) > 3e-4
    assert not held.loose.any()
    other = replace(known, loose=[(JOINTS[0][0], frozenset({"hand"}))] * 2)
    moved = spot_of(rig.project(p_W)[0], 0.05, RIG, MIRROR, other).place
    assert not moved.loose.any()


RAISED = transform(np.eye(3), [0.02, 0.01, 0.22])
"""Where an arm is held up, before the glass."""


def held_up(loose=(), covariance=None):
    """Return that arm, which turns about the same elbow."""
    solid = Solid("ellipsoid", (0.03, 0.03, 0.03), RAISED)
    return PosedBody(
        [solid], ["arm"], {"arm": RAISED}, [], np.diag(np.full(3, 1e-12)), {"arm": 1e-5},
        loose, np.zeros((0, 0)) if covariance is None else covariance,
    )  # fmt: skip


def on_its_near_side(way):
    """Return a place of it that both cameras see directly. Shape (1, 3)."""
    aim = RAISED[:3, 3] + way
    eye = np.array([0.035, 0.0, 0.0])
    return onto_solids(held_up().solids, eye[None], (aim - eye)[None] / np.linalg.norm(aim - eye))


@pytest.mark.slow
def test_a_mark_on_an_arm_before_the_glass_is_as_exactly_placed_as_is_said():
    rng, chi = np.random.default_rng(7), []
    known = held_up(JOINTS, LOOSE)
    for _ in range(200):
        p_W = on_its_near_side(0.008 * rng.standard_normal(3))
        turns = rng.multivariate_normal(np.zeros(2), LOOSE)
        pixels = RIG.project(turned(p_W, turns))[0] + 0.1 * rng.standard_normal(4)
        spot = spot_of(pixels, 0.1, RIG, MIRROR, known)
        assert spot is not None
        if spot.kind != ON_ME:
            continue
        assert spot.directly
        off = spot.place.p_FM - (p_W[0] - RAISED[:3, 3])
        chi.append(off @ np.linalg.pinv(spot.place.own + spot.place.common, 1e-6) @ off)
    assert len(chi) > 190
    assert 0.75 < np.mean(chi) / 2.0 < 1.25


def test_what_is_seen_beside_an_arm_before_the_glass_is_not_on_it():
    p_W = on_its_near_side(np.zeros(3)) + np.array([0.06, 0.0, 0.0])
    spot = spot_of(RIG.project(p_W)[0], 0.1, RIG, MIRROR, held_up())
    assert (spot.kind, spot.directly) == (NOT_ON_ME, True)


def test_the_back_of_an_arm_before_the_glass_is_seen_in_the_mirror_alone():
    back = RAISED[:3, 3][None] + [0.0, 0.0, 0.03]
    image = spot_of(MirrorRig(RIG, MIRROR).project(back)[0], 0.1, RIG, MIRROR, held_up())
    assert (image.kind, image.directly) == (ON_ME, False)
    np.testing.assert_allclose(image.place.p_FM, [0.0, 0.0, 0.03], atol=1e-6)


@pytest.mark.parametrize("sure", [(True, False), (False, True), (False, False)])
def test_a_spot_and_its_reflection_are_one_which_is_as_sure_as_the_surer(sure):
    side = RAISED[:3, 3][None] + [0.03, 0.0, 0.0]  # where both its sides are seen
    image = spot_of(MirrorRig(RIG, MIRROR).project(side)[0], 0.1, RIG, MIRROR, held_up())
    direct = spot_of(RIG.project(side)[0], 0.1, RIG, MIRROR, held_up())
    assert (image.directly, direct.directly) == (False, True)
    assert seen_once([(direct, sure[0]), (image, sure[1])]) == [(image, any(sure))]
    apart = spot_of(RIG.project(on_its_near_side(np.zeros(3)))[0], 0.1, RIG, MIRROR, held_up())
    other = Spot(NOT_ON_ME, None, 99.0, directly=True)
    told = [(apart, True), (image, False), (other, True)]
    assert seen_once(told) == told


def found_at(p_FM, sigma, link="arm"):
    spot = Spot(ON_ME, None, 0.0)
    return Finding(ON_ME, link, np.array(p_FM), sigma**2 * np.diag([1.0, 1.0, 0.0]), (spot,))


def test_parts_that_turn_out_to_have_one_middle_are_one_mark_the_better_known_of_them():
    part, whole = found_at([0.0, 0.0, 0.03], 6e-4), found_at([0.0, 4e-4, 0.03], 3e-4)
    (told,) = told_once([part, whole])
    assert told.spots == (*part.spots, *whole.spots)
    np.testing.assert_array_equal(told.p_FM, whole.p_FM)
    np.testing.assert_array_equal(told.covariance, whole.covariance)


@pytest.mark.parametrize(("p_FM", "link"), [([0.0, 4e-3, 0.03], "arm"), ([0.0, 0.0, 0.03], "hand")])
def test_marks_that_lie_apart_or_on_two_links_are_two(p_FM, link):
    one, other = found_at([0.0, 0.0, 0.03], 6e-4), found_at(p_FM, 3e-4, link)
    assert told_once([one, other]) == [one, other]
