"""What of a picture another shows in nearly the same place."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.images.motion_mask import CELL
from nico_selfmodel.vision.images.standing_cells import standing_cells

NOISE = 2.0


def textured(rng, size=(96, 128), blob=2.0):
    """A picture of blobs, without noise."""
    gray = cv2.GaussianBlur(rng.normal(size=size), (0, 0), blob)
    return 120.0 + 40.0 * gray / gray.std()


def seen(gray, rng):
    noisy = np.clip(np.round(gray + NOISE * rng.normal(size=gray.shape)), 0, 255).astype(np.uint8)
    return cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR)


def moved(gray, right, down):
    return np.roll(gray, (down, right), axis=(0, 1))


@pytest.mark.parametrize(
    ("right", "down", "light", "changed"),
    [
        (0, 0, 1.0, False),
        (11, -12, 1.0, False),
        (3, 2, 1.3, False),
        (3, 2, 0.7, False),
        (40, 0, 1.0, True),
        (0, -40, 1.0, True),
        (30, 30, 1.3, True),
    ],
)
def test_what_goes_elsewhere_is_told_from_what_stands_be_it_lit_otherwise(
    right, down, light, changed
):
    rng = np.random.default_rng(3)
    gray = textured(rng)
    found = standing_cells(seen(gray, rng), seen(light * moved(gray, right, down), rng), NOISE)
    inner = (slice(1, -1), slice(1, -1))  # what is beside a picture may come in
    assert found.shows.mean() > 0.8
    share = found.changed[inner][found.shows[inner]].mean()
    assert share > 0.9 if changed else share < 0.05
    assert not (found.changed & ~found.shows).any()


def test_plain_places_and_straight_edges_show_nothing():
    rng = np.random.default_rng(4)
    plain = np.full((96, 128), 120.0)
    edge = plain.copy()
    edge[:, 56:] = 200.0
    for gray in (plain, edge):
        assert not standing_cells(seen(gray, rng), seen(gray, rng), NOISE).shows.any()
    corner = plain.copy()
    corner[:40, :56] = 200.0
    rows, columns = np.nonzero(standing_cells(seen(corner, rng), seen(corner, rng), NOISE).shows)
    assert (rows.tolist(), columns.tolist()) == ([40 // CELL], [56 // CELL])


def test_pictures_that_do_not_belong_together_are_refused():
    one = np.zeros((64, 64, 3), dtype=np.uint8)
    for other in (one[:32], one[:, :, 0]):
        with pytest.raises(ValueError, match="two pictures must have one shape"):
            standing_cells(one, other, NOISE)
