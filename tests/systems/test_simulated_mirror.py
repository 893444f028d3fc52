"""A simulated body before mirrors: what it shows, and that it shows no more."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.experiments.mirror_body import MIRRORS, mirror_body
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig


@pytest.fixture(scope="module")
def body():
    return mirror_body(3)


def test_reflections_are_those_of_the_true_parts(body):
    quiet = mirror_body(3, pixel_sigma=1e-9, play_deg=0.0)
    seen = quiet.watch("middle", 12)
    known = quiet.calibrated()
    rig = MirrorRig(known.rig, quiet.ground_truth.mirrors["middle"])
    assert_allclose(rig.project(known.predict(seen.encoders).p_WH), seen.pixels, atol=1e-6)
    direct = quiet.watch("", 5)
    assert set(direct.mirror.tolist()) == {""}
    p = known.predict(direct.encoders).p_WH
    assert_allclose(known.rig.project(p), direct.pixels, atol=1e-6)


def test_poses_keep_the_hand_off_the_glass_and_inside_both_images(body):
    for name in MIRRORS:
        seen = body.watch(name, 30)
        p = body.calibrated().predict(seen.encoders).p_WH
        assert body.ground_truth.mirrors[name].in_front_by(p).min() > 0.04
        assert (seen.pixels > 0.0).all()
        assert (seen.pixels < np.array([640, 480, 640, 480])).all()
        assert set(seen.mirror.tolist()) == {name}


def test_a_session_can_be_repeated_and_another_differs(body):
    first, again, other = (body.watch("near", 5, session) for session in (1, 1, 2))
    assert np.array_equal(first.pixels, again.pixels)
    assert not np.array_equal(first.encoders, other.encoders)


def test_mirrors_stand_a_little_off_from_where_they_were_meant_to(body):
    for name, meant in MIRRORS.items():
        assert 0.01 < np.degrees(body.ground_truth.mirrors[name].angle_to(meant)) < 10.0


def test_no_public_number_is_one_of_the_truth(body):
    known = body.calibrated()
    truth = np.concatenate([known.servos.offset, known.servos.gear, known.rig.left.values[:4]])
    public = [getattr(body, name) for name in dir(body) if not name.startswith("_")]
    shown = np.array([float(x) for x in public if isinstance(x, int | float)])
    assert np.abs(shown[:, None] - truth).min() > 1e-7
    stops = np.array([[joint.lower, joint.upper] for joint in body.joints])
    assert (stops == np.round(stops)).all()


def test_commanded_poses_can_be_visited(body):
    seen = body.watch("far", 6)
    again = body.move_and_measure("far", seen.encoders, session=4)
    assert np.linalg.norm(again - seen.pixels, axis=1).max() < 10.0
    assert np.isnan(body.move_and_measure("", seen.encoders)).any()


def test_what_does_not_exist_is_refused(body):
    with pytest.raises(ValueError, match="no mirror 'wall'; there are near, middle, far"):
        body.watch("wall", 3)


def test_a_curved_mirror_shows_other_reflections():
    flat, bent = mirror_body(3), mirror_body(3, radius=3.0)
    seen = flat.watch("middle", 8)
    moved = np.linalg.norm(bent.move_and_measure("middle", seen.encoders) - seen.pixels, axis=1)
    assert np.nanmin(moved) > 5.0
    found = calibrate_mirrors(bent.watch("middle", 10), bent.calibrated())
    assert not found.flatness["middle"].flat
