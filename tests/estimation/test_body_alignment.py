"""What pictures tell of a body beside the colours that it may have."""

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.body_alignment import (
    _GAIN_SIGMA,
    AlignedView,
    Alignment,
    BodyMotion,
    _equations,
    _Levels,
    _normal_equations,
)
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

AREA = 40.0
LEVELS, VALUES, PAINTS = 400, 5, 6


def levels(rng, cells=True):
    shown = rng.integers(-1, PAINTS, LEVELS) if cells else np.full(LEVELS, -1)
    expected = rng.uniform(20.0, 200.0, LEVELS)
    return _Levels(rng.standard_normal((LEVELS, VALUES)), expected, np.zeros(LEVELS), shown)


def seen_with(rows, by):
    """Return what is seen where values, paints and the gain differ by so much."""
    J = slopes_of(rows)
    return _Levels(rows.slopes, rows.expected, J @ by, rows.cells)


def slopes_of(rows):
    paints = (rows.cells[:, None] == np.arange(PAINTS)) * rows.expected[:, None]
    return np.column_stack([rows.slopes, paints, rows.expected])


def test_the_gain_of_a_picture_is_eliminated():
    rng = np.random.default_rng(0)
    rows = levels(rng)
    rows = _Levels(rows.slopes, rows.expected, 0.1 * rng.standard_normal(LEVELS), rows.cells)
    H, pull = _normal_equations(rows, AREA, PAINTS)
    J, weight = slopes_of(rows), 1.0 / (0.3**2 * 3.0 * AREA)  # the least scale, and no outlier
    whole = weight * J.T @ J
    whole[-1, -1] += _GAIN_SIGMA**-2
    n = VALUES + PAINTS
    schur = whole[:n, :n] - np.outer(whole[:n, n], whole[:n, n]) / whole[n, n]
    right = weight * J.T @ rows.errors
    np.testing.assert_allclose(H, schur, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(pull, right[:n] - whole[:n, n] * right[n] / whole[n, n], atol=1e-9)


@pytest.mark.parametrize("asked", [True, False])
def test_colours_that_are_asked_for_do_not_move_the_body(asked):
    rng = np.random.default_rng(1)
    rows = levels(rng)
    by = np.concatenate([rng.standard_normal(VALUES), 0.05 * rng.standard_normal(PAINTS), [0.02]])
    H, pull = _normal_equations(seen_with(rows, by), AREA, PAINTS if asked else 0)
    found = np.linalg.solve(H + 1e-9 * np.eye(len(H)), pull)[:VALUES]
    assert (np.abs(found - by[:VALUES]).max() < 0.02) == asked


def test_what_shows_no_paint_tells_no_colour():
    H, pull = _normal_equations(levels(np.random.default_rng(2), cells=False), AREA, PAINTS)
    assert not H[VALUES:].any()
    assert not pull[VALUES:].any()


def test_a_change_is_measured_in_its_sigmas():
    change = np.array([3e-3, 0.4])
    assert Alignment(change, np.diag([1e-3, 0.1]) ** 2).sigmas == pytest.approx(5.0)


def view_of(by_light):
    """Return a picture with slopes of which the left half shows a part that turns."""
    rng = np.random.default_rng(3)
    expected = rng.uniform(50.0, 150.0, (12, 16, 3))
    moved = np.zeros((2, 12, 16), dtype=bool)
    moved[:, :, :8] = True
    return AlignedView(
        0, 0, 0.9 * expected, expected, np.full((12, 16), 0.8), np.ones((12, 16), dtype=bool),
        moved, by_light,
    )  # fmt: skip


def test_shades_of_a_part_that_turns_stay_with_the_light_and_those_of_one_that_shifts_go_with_it():
    mirror, axis = Mirror.from_values([0.0, -0.3, 0.3]), np.array([0.0, 0.6, 0.8])
    motions = [BodyMotion(axis, np.zeros(3)), BodyMotion(axis, None)]
    by_light = np.random.default_rng(4).standard_normal((12, 16, 3, 3))
    plain, lit = (
        _equations(view_of(light), NICO_CAMERAS, [mirror], motions, ()).slopes
        for light in (None, by_light)
    )
    turned = (0.9 * by_light @ axis).reshape(-1)  # by the light, with the picture's gain
    left = np.repeat(np.arange(12 * 16) % 16 < 8, 3)
    np.testing.assert_allclose(lit[:, 3], plain[:, 3] - np.where(left, turned, 0.0), atol=1e-9)
    np.testing.assert_allclose(lit[:, 4], plain[:, 4], atol=1e-12)
    np.testing.assert_allclose(lit[:, 5:], 0.9 * by_light.reshape(-1, 3), atol=1e-9)
