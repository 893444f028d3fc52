"""A body in pictures: the room behind it, the seams of its parts, what covers it."""

import numpy as np
import pytest

from nico_selfmodel.vision.images.body_in_room import before_room, seam, within_hulls


def test_a_body_is_expected_before_the_room_as_it_is_seen_beside_it():
    room = np.tile([90.0, 80.0, 70.0], (60, 80, 1))
    room[:, :, 0] += 0.5 * np.arange(80)  # it is not alike everywhere
    body = np.zeros((60, 80), dtype=bool)
    body[:, 30:45] = True
    expected = np.where(body[:, :, None], [40.0, 120.0, 200.0], 7.0)
    picture = np.where(body[:, :, None], 0.8 * expected, room)
    found = before_room(expected, picture, body, body)
    assert np.array_equal(found[body], expected[body])
    beside = found[:, [27, 48]]
    np.testing.assert_allclose(0.8 * beside, picture[:, [27, 48]], atol=6.0)


def test_a_body_that_fills_the_picture_is_expected_as_it_was():
    picture = np.full((60, 80, 3), 50.0)
    everywhere = np.ones((60, 80), dtype=bool)
    assert np.array_equal(before_room(picture, 0.8 * picture, everywhere, everywhere), picture)


@pytest.mark.parametrize(("step", "met"), [(0.0, True), (0.009, True), (0.011, False)])
def test_parts_meet_where_neither_is_behind_the_other(step, met):
    part, others = np.zeros((2, 40, 40), dtype=bool)
    part[:, :20], others[:, 20:] = True, True
    found = seam(part, others, np.where(part, 1.0, 1.0 + step))
    assert found[20].any() == met
    assert not found[:, :10].any()
    if met:
        assert np.flatnonzero(found[20]).tolist() == list(range(16, 24))


def test_what_is_within_a_hull_or_next_to_it_is_covered_unless_a_pixel_is_unknown():
    square = np.array([[10.0, 10.0], [20.0, 10.0], [20.0, 20.0], [10.0, 20.0], [15.0, 15.0]])
    found = within_hulls([square, square + 20.0, np.full((3, 2), np.nan)], (60, 60))
    assert found[9:22, 9:22].all()
    assert found[29:42, 29:42].all()
    assert found.sum() == 2 * 13 * 13
