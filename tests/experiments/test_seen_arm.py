"""A robot sees in a mirror where its loose joints have left its arm, and its finger."""

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.mirrors.body_alignment import AlignedView, Alignment, BodyMotion
from nico_selfmodel.experiments.mirror_test import touches
from nico_selfmodel.experiments.mirror_test.touches import SEEN_ON, TRIES, TouchJudge
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.plant.touching.touch_planner import Touch
from nico_selfmodel.sessions.looks import seen_arm
from nico_selfmodel.sessions.looks.expecting import Unknown
from nico_selfmodel.sessions.looks.seen_arm import SeenArm, see_arm
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR
from nico_selfmodel.systems.looking import FINGER
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.mark_on_body import Mark

from ..knowing_nico import knowing

POSTURES = np.array([
    [-0.9, 0.25, 0.4, -1.9, 0.2, 0.1],
    [-1.1, 0.35, 0.2, -1.7, -0.3, -0.1],
    [-0.7, 0.2, 0.6, -1.8, 0.4, 0.2],
    [-1.0, 0.5, 0.3, -1.6, 0.0, 0.0],
])  # fmt: skip
"""The hand before the chest [rad]."""
HANGING = np.array([0.0, 0.3, 0.0, -0.2, 0.0, 0.0])


@pytest.fixture(scope="module")
def known():
    return knowing(3)


@pytest.fixture(scope="module")
def toucher(known):
    nico = known.before.nico
    judge = TouchJudge(nico)
    with BodyImage(nico.arm, known.robot.model) as image, known.before.station(11) as station:
        yield touches._Toucher(known, image, station, judge)


@pytest.mark.slow
def test_the_finger_is_seen_nearer_to_where_it_is_than_encoders_have_it(known, toucher):
    image, looks, station = toucher._image, toucher._looks, toucher._station
    p_FE, servos = toucher._finger.p_FE, known.robot.model.servos
    off = []
    for q in POSTURES:
        shot = looks.shot(MIRROR, servos.to_encoder(q[None])[0])
        true = apply(station.surfaces_true(looks.body.context)[FINGER][1], p_FE[None])[0]
        read = apply(image.poses(shot.readings)[FINGER], p_FE[None])[0]
        seen = see_arm(image, known.body, shot)
        assert (np.linalg.eigvalsh(seen.covariance) > 0.0).all()
        now = apply(image.poses(servos.to_encoder(seen.q[None])[0])[FINGER], p_FE[None])[0]
        off.append([np.linalg.norm(read - true), np.linalg.norm(now - true)])
    read, seen = np.sqrt(np.mean(np.square(off), axis=0))
    assert read > 1e-3
    assert seen < 0.6 * read
    assert seen < 1.5e-3


@pytest.mark.slow
def test_pictures_that_hardly_show_the_arm_tell_nothing_of_it(known, toucher, monkeypatch):
    shot = toucher._looks.shot(MIRROR, known.robot.model.servos.to_encoder(POSTURES[:1])[0])

    def hardly(*_):
        raise EstimationError("only 3 grey levels")

    monkeypatch.setattr(seen_arm, "alignment_step", hardly)
    assert see_arm(toucher._image, known.body, shot) is None


@pytest.mark.slow
def test_an_arm_is_not_seen_where_joints_so_loose_hardly_ever_stand(known, toucher, monkeypatch):
    looks, servos = toucher._looks, known.robot.model.servos
    shot = looks.shot(MIRROR, servos.to_encoder(POSTURES[1:2])[0])
    seen = see_arm(toucher._image, known.body, shot)
    assert not seen.attached[0].all()
    assert seen.hand >= {"right_hand", FINGER}
    assert np.allclose(servos.to_encoder(seen.q[None])[0], seen.readings)
    for far, there in ((4.70, True), (4.78, False)):  # chi-square 22.1 and 22.8 of 6
        steps = iter([far * seen_arm.LOOSE, 0.0, 0.0])

        def turned(views, *_, steps=steps):
            change = np.zeros(len(views[0].moved) + 3)
            change[3] = next(steps)
            return Alignment(change, np.eye(len(change)))

        monkeypatch.setattr(seen_arm, "alignment_step", turned)
        assert (see_arm(toucher._image, known.body, shot) is not None) == there


@pytest.mark.slow
def test_an_arm_is_followed_until_it_stands_still_by_coarse_pictures_first(
    known, toucher, monkeypatch
):
    """Four steps found 2.2 of 3 deg; coarse pictures and fine ones by turns never end."""
    looks, servos = toucher._looks, known.robot.model.servos
    shot = looks.shot(MIRROR, servos.to_encoder(POSTURES[1:2])[0])
    view, smooth = seen_arm.aligned_view, []

    def seen(*args, **options):
        smooth.append(options["smooth"])
        return view(*args, **options)

    def turned(by):
        left = iter(np.radians(by))

        def step(views, *_):
            change = np.zeros(len(views[0].moved) + 3)
            change[3] = next(left)
            return Alignment(change, np.eye(len(change)))

        smooth.clear()
        monkeypatch.setattr(seen_arm, "alignment_step", step)
        return see_arm(toucher._image, known.body, shot)

    monkeypatch.setattr(seen_arm, "aligned_view", seen)
    found = turned([1.0, -0.8, 0.4, -0.6, 0.2, 0.05])
    assert smooth[::2] == [3.0, 3.0, 3.0, 1.0, 1.0, 1.0]
    assert np.degrees(found.q - servos.to_joint(shot.readings[None])[0])[0] == pytest.approx(0.25)
    assert turned([0.2, -0.2] * 20) is None
    assert len(smooth) == 2 * seen_arm._STEPS


@pytest.mark.slow
def test_joints_do_not_turn_far_to_explain_an_arm_that_is_shifted(known, toucher, monkeypatch):
    """Of a hanging arm two joints turn about nearly one line, and hardly move it together."""
    looks, servos = toucher._looks, known.robot.model.servos
    shot = looks.shot(MIRROR, servos.to_encoder(HANGING[None])[0])
    start, shifted = servos.to_joint(shot.readings[None])[0], np.eye(4)
    shifted[:3, 3] = known.body.X_WB[:3, 3] + [0.0, 6e-4, 0.0]

    def turned(stands):
        toucher._image.hold(known.body.angles, stands)
        return np.abs(see_arm(toucher._image, known.body, shot).q - start)

    plain, far = turned(known.body.X_WB), turned(shifted)
    monkeypatch.setattr(seen_arm, "SHOULDER", 1e-7)
    farther = turned(shifted)
    toucher._image.hold(known.body.angles, known.body.X_WB)
    assert np.abs(far - plain).max() < 0.5 * np.abs(farther - plain).max()


def test_shades_of_a_limb_tell_nothing_of_how_it_stands_and_its_edges_do(monkeypatch):
    """A picture that gets brighter from column to column, by more and more."""
    levels = np.cumsum(np.arange(20.0) / 2.0)
    expected = np.repeat(np.tile(levels, (10, 1))[:, :, None], 3, axis=2)
    everywhere, nowhere = np.ones((10, 20), bool), np.zeros((10, 20), bool)

    def view(*_, **__):
        moved = np.stack([everywhere, nowhere])
        return AlignedView(0, 0, expected, expected, np.ones((10, 20)), everywhere, moved)

    monkeypatch.setattr(seen_arm, "aligned_view", view)
    monkeypatch.setattr(seen_arm._Standing, "attached", lambda *_: nowhere)
    ways = [(BodyMotion(np.eye(3)[0], np.zeros(3)), frozenset({"arm"}))] * 2
    standing = seen_arm._Standing(None, None, None, ways, frozenset(), {})
    slope = np.gradient(levels)
    np.testing.assert_array_equal(standing.view(0, 1.0).used[5], slope > 8.0)
    assert (slope > 8.0).any()
    assert (slope[slope < 8.0] > 7.0).any()


@pytest.mark.slow
def test_an_unmarked_arm_is_judged_and_does_not_surprise(known, toucher):
    looks, image = toucher._looks, toucher._image
    X_BM = known.before.views[MIRROR].X_BM
    looks.before_known(MIRROR, known.body, Unknown(dict.fromkeys(image.links.values(), 7e-4)), X_BM)
    pair = looks.look(known.robot.model.servos.to_encoder(POSTURES[3:])[0])
    # The right camera sees a hand that is held up and little else.
    left = pair[0].surprise.chi_square[np.isin(pair[0].labels, [*image.moving])]
    assert np.isfinite(left).sum() > 300
    assert np.nanmax(left) < 35.0


@pytest.mark.slow
@pytest.mark.parametrize(("off", "tries"), [((0.9,), 1), ((1.1, 0.9), 2), ((1.1,) * TRIES, TRIES)])
def test_the_finger_goes_again_until_it_is_seen_on_the_mark(
    known, toucher, monkeypatch, off, tries
):
    left = [SEEN_ON * one for one in off]
    monkeypatch.setattr(toucher, "_seen_off", lambda *_: left.pop(0))
    way = known.robot.model.servos.to_encoder(POSTURES)
    plan = Touch(POSTURES, way, np.zeros((4, 3)), 0.006, 0.2)
    ways = toucher.go(plan, ("chest", np.zeros(3), np.ones(3)))
    assert len(ways) == tries
    assert not left
    # Joints are loose by half a degree, and slip by one now and then.
    assert 0.0 < np.abs(np.array(ways) - POSTURES).max() < np.radians(6.0)


@pytest.mark.slow
def test_the_finger_is_off_by_what_it_is_seen_beside_the_place_along_the_surface(
    known, toucher, monkeypatch
):
    q, image, servos = POSTURES[0], toucher._image, known.robot.model.servos
    poses = image.poses(known.robot.model.servos.to_encoder(q[None])[0])
    end = apply(inverse(poses["chest"]) @ poses[FINGER], toucher._finger.p_FE[None])[0]
    place = "chest", end + np.array([0.004, 0.0, 0.02]), np.array([0.0, 0.0, 2.0])
    nothing = (np.zeros((1, 1), dtype=bool),) * 2
    arm = SeenArm(q, np.eye(6), servos.to_encoder(q[None])[0], [], nothing, frozenset())
    monkeypatch.setattr(touches, "see_arm", lambda *_, **__: arm)
    assert toucher._seen_off(None, place) == pytest.approx(0.004)
    monkeypatch.setattr(touches, "see_arm", lambda *_, **__: None)
    assert toucher._seen_off(None, place) == 0.0


@pytest.mark.slow
def test_the_last_time_counts_for_the_place_and_every_time_for_what_else_is_touched(known):
    judge = TouchJudge(known.before.nico)
    mark = Mark("chest", np.array([0.06, 0.0, 0.1]), 0.01, np.ones(3))
    normal = np.array([1.0, 0.0, 0.0])
    near, far = np.tile(POSTURES[0], (4, 1)), np.tile(POSTURES[3], (4, 1))
    alone = [judge.gone([way], mark, normal) for way in (near, far)]
    both = judge.gone([near, far], mark, normal)
    assert both.off == pytest.approx(alone[1].off)
    assert both.off != pytest.approx(alone[0].off, abs=1e-3)
    assert both.clearance == pytest.approx(min(one.clearance for one in alone))
    assert (both.tries, alone[0].tries) == (2, 1)
