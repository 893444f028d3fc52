"""Reprojection errors of boards: their derivatives, the corners not seen, the names."""

import numpy as np
import pytest

from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.model.cameras.projection import INTRINSICS

from ..slow_rest import slow_rest
from .simulated_boards import LEFT, P_GQ, RIG, RIGHT, boards, pictures, unseen

CASES = [
    pytest.param(cameras, aspect, gaps, id=f"{'+'.join(cameras)}, aspect {aspect}, gaps {gaps}")
    for cameras in (("left", "right"), ("left",), ("right",))
    for aspect in (None, 1.01)
    for gaps in (False, True)
]


def residuals_of(sides, aspect, gaps, sigma=0.5):
    """Return a block, and variables that lie aside of its start."""
    X_LG = boards(3, seed=4)
    views = pictures(X_LG, sigma=0.3)
    if gaps:
        views = unseen(views, (0, slice(3, 20), LEFT), (1, slice(None), RIGHT), (2, 7))
    cameras = RIG.cameras
    if len(sides) == 1:
        views = views.only(sides[0])
        X_LG = X_LG[[int(name) for name in views.names]]
        cameras = (cameras[("left", "right").index(sides[0])].at(np.eye(4)),)
    block = BoardResiduals(views, X_LG, sigma, aspect)
    x = block.start_of(cameras, X_LG)
    rng = np.random.default_rng(1)
    size = np.where([n.endswith((".fx", ".fy", ".cx", ".cy")) for n in block.names], 2.0, 0.01)
    return block, x + size * rng.uniform(-1.0, 1.0, len(x))


@pytest.mark.parametrize(("cameras", "aspect", "gaps"), slow_rest(CASES, plain=2))
def test_the_derivatives_are_those_of_central_differences(cameras, aspect, gaps):
    block, x = residuals_of(cameras, aspect, gaps)
    _, jacobian = block.evaluate(x)
    for i, name in enumerate(block.names):
        h = 1e-4 if name.endswith((".fx", ".fy", ".cx", ".cy", ".skew")) else 1e-6
        step = h * (np.arange(len(x)) == i)
        numeric = (block.residuals(x + step) - block.residuals(x - step)) / (2.0 * h)
        size = max(np.abs(numeric).max(), 1e-3)
        assert jacobian[i] == pytest.approx(numeric, abs=2e-7 * size), name


@pytest.mark.parametrize(("sides", "aspect", "gaps"), CASES)
def test_the_residuals_are_those_of_the_cameras_that_the_variables_describe(sides, aspect, gaps):
    block, x = residuals_of(sides, aspect, gaps, sigma=0.25)
    cameras, X_LG = block.cameras(x), block.board_poses(x)
    views = block.views
    shown = np.einsum("vij,pj->vpi", X_LG[:, :3, :3], P_GQ) + X_LG[:, None, :3, 3]
    expected = np.concatenate(
        [
            camera.project(shown.reshape(-1, 3)).reshape(len(views), -1, 2) - views.of_camera(side)
            for side, camera in zip(sides, cameras, strict=True)
        ],
        axis=2,
    )
    r = block.evaluate_parts(x)[0]
    assert block.pixel_residuals(r) == pytest.approx(-expected, abs=1e-9, nan_ok=True)
    assert np.sum(r**2) == pytest.approx(np.nansum(expected**2) / 0.25**2)
    if aspect is not None:
        assert [c.fy / c.fx for c in cameras] == pytest.approx([aspect] * len(sides))


def test_corners_that_were_not_seen_say_nothing():
    block, x = residuals_of(("left", "right"), None, True)
    r, by_shared, by_own = block.evaluate_parts(x)
    cameras = r.reshape(3, 2, 2, 54)  # view, camera, coordinate, corner
    assert not cameras[0, 0, :, 3:20].any()
    assert not cameras[1, 1].any()
    assert not cameras[2, :, :, 7].any()
    assert np.all(cameras[0, 1] != 0.0)
    hidden = r == 0.0
    assert hidden.sum() == 2 * (17 + 54 + 2)
    assert not np.moveaxis(by_shared, 1, 2)[hidden].any()
    assert not np.moveaxis(by_own, 1, 2)[hidden].any()
    assert np.isnan(block.pixel_residuals(r)).sum() == hidden.sum()


def test_the_names_are_those_of_the_rig_and_then_of_each_board():
    block, x = residuals_of(("left", "right"), None, False)
    assert block.shared_names == RIG.names
    assert len(x) == len(block.names) == 26 + 3 * 6
    assert block.names[26:28] == ("board.00.rx", "board.00.ry")
    assert block.names[-1] == "board.02.z"
    assert block.observation_count == 3
    alone, _ = residuals_of(("right",), 1.01, False)
    assert alone.shared_names == tuple(f"right.{n}" for n in INTRINSICS if n != "fy")


@pytest.mark.parametrize("aspect", [None, 383.0 / 381.0])
def test_a_start_is_the_cameras_and_boards_that_it_was_made_of(aspect):
    X_LG = boards(3, seed=4)
    block = BoardResiduals(pictures(X_LG), X_LG, 1.0, aspect)
    x = block.start_of(RIG.cameras, X_LG)
    assert block.board_poses(x) == pytest.approx(X_LG, abs=1e-15)
    left, right = block.cameras(x)
    assert left.values == pytest.approx(RIG.left.values)
    assert pytest.approx(RIG.right.X_WC, abs=1e-14) == right.X_WC
    if aspect is None:
        assert np.abs(block.residuals(x)).max() < 1e-10
    # The boards' rotation vectors turn them about the frame of the camera.
    x[block.names.index("board.01.ry")] = 0.3
    turned = rotation_from_vector([0.0, 0.3, 0.0]) @ X_LG[1, :3, :3]
    assert block.board_poses(x)[1, :3, :3] == pytest.approx(turned, abs=1e-14)


def test_another_sigma_gives_other_residuals_where_the_same_was_asked_before():
    block, x = residuals_of(("left", "right"), None, gaps=True, sigma=1.0)
    before = block.evaluate_parts(x)
    assert all(a is b for a, b in zip(before, block.evaluate_parts(x), strict=True))
    block.sigma = 0.5
    for one, other in zip(before, block.evaluate_parts(x), strict=True):
        assert np.any(one != 0.0)
        np.testing.assert_allclose(other, 2.0 * one)
