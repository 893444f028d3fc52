"""Outlines before a plain room, and depths of a pair."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.vision.images.body_outline import (
    beyond_body,
    beyond_by_depth,
    plain_color,
    shows_room,
)
from nico_selfmodel.vision.images.stereo_depth import RectifiedPair

ROOM = np.array([110.0, 102.0, 92.0])


def disc(radius, noise=2.0, color=(40, 60, 180), room=0.93 * ROOM):
    """Return a picture of a disc before a room, smooth at its edge; and how far pixels are."""
    v, u = np.mgrid[0:240, 0:320]
    beyond = np.hypot(u - 150.3, v - 120.8) - radius
    share = np.clip(0.5 - beyond, 0.0, 1.0)[:, :, None]
    picture = share * np.array(color) + (1.0 - share) * room
    picture += np.random.default_rng(0).normal(0.0, noise, picture.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8), beyond


def test_the_outline_of_a_disc_is_right_to_a_fraction_of_a_pixel():
    picture, beyond = disc(50.0)
    found = beyond_body(picture, ROOM, 2.0)
    near = np.abs(beyond) < 5.0
    assert abs(np.mean(found[near] - beyond[near])) < 0.1
    assert np.sqrt(np.mean((found[near] - beyond[near]) ** 2)) < 0.25


def test_what_is_beside_the_glass_is_neither_body_nor_room():
    picture, beyond = disc(50.0)
    picture[:, :30] = np.rint(ROOM)
    picture[-12:, -12:] = 0
    found = beyond_body(picture, ROOM, 2.0)
    assert np.isnan(found[40:200, 5:25]).all()
    assert np.isnan(found[-5:, -5:]).all()
    assert np.isfinite(found[np.abs(beyond) < 20.0]).all()


def test_the_commonest_colour_is_found_below_a_grey_level():
    np.testing.assert_allclose(plain_color(disc(50.0)[0]), 0.93 * ROOM, atol=0.2)


def test_a_room_of_another_colour_is_not_the_plain_one():
    assert shows_room(plain_color(disc(50.0)[0]), ROOM)
    assert not shows_room(np.array([30.0, 200.0, 90.0]), ROOM)


def test_an_empty_room_is_refused():
    with pytest.raises(EstimationError, match="nothing stands"):
        beyond_body(disc(0.0, color=0.93 * ROOM)[0], ROOM, 2.0)


def test_a_plane_is_as_far_away_as_its_disparity_says():
    left = Camera(200.0, 200.0, 159.5, 119.5, (320, 240))
    rig = StereoRig(left, left.at(transform(np.eye(3), [0.07, 0.0, 0.0])))
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.integers(0, 255, (120, 200, 3)).astype(np.uint8), (400, 240))
    # 20 px between the cameras: 200 px * 0.07 m / 20 px = 0.7 m.
    pictures = wall[:, 20:340].copy(), wall[:, 40:360].copy()
    for side in (0, 1):
        depth = RectifiedPair.of(rig).depth(pictures, 0.3, side)
        middle = depth[40:200, 80:240] if side else depth[40:200, 80:280]
        assert np.isfinite(middle).mean() > 0.95
        np.testing.assert_allclose(np.nanmedian(middle), 0.7, rtol=0.01)


def test_what_a_turned_pair_tells_goes_back_to_the_pixels_of_its_cameras():
    left = Camera(200.0, 200.0, 159.5, 119.5, (320, 240), k1=0.1)
    right = left.at(transform(rotation_from_vector([0.02, -0.05, 0.03]), [0.07, 0.0, 0.0]))
    pair = RectifiedPair.of(StereoRig(left, right))
    picture = np.zeros((240, 320), np.uint8)
    picture[90:150, 110:210] = 1
    for side in (0, 1):
        back = pair.unbent(pair.bent(picture, side), side)
        assert np.mean(back != picture) < 0.01


def test_depths_tell_the_side_of_an_outline_but_not_where_it_is():
    picture, beyond = disc(50.0)
    lost = np.random.default_rng(0).uniform(size=beyond.shape) < 0.02
    body, other = (beyond < 0.0) & ~lost, (beyond > 3.0) & ~lost
    found = beyond_by_depth(picture, ROOM, body, other)
    assert np.isnan(found[np.abs(beyond) < 3.0]).all()
    assert (found[beyond < -7.0] == -60.0).all()
    assert (found[beyond > 10.0] == 60.0).all()


def test_what_has_the_colour_of_a_plain_room_is_no_body_by_its_depth():
    picture, beyond = disc(50.0)
    found = beyond_by_depth(picture, ROOM, beyond < 12.0, beyond > 15.0)
    assert np.isnan(found[(beyond > -2.0) & (beyond < 12.0)]).all()
