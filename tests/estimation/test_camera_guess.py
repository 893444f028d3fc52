"""Where two cameras stand, from markers that both saw."""

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.camera_guess import _sampson, relative_pose
from nico_selfmodel.geometry.epipolar import essential
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import transform

WITHIN = 4.0 / 600.0


def two_views(seed, noise_px=0.3):
    """Ideal coordinates of 90 points, which 0.1 m of depth tell, from 0.5 m apart; and X_BA."""
    rng = np.random.default_rng(seed)
    X_BA = transform(rotation_from_vector([0.02, 0.38, 0.01]), [-0.5, 0.01, 0.1])
    p_A = rng.normal(size=(90, 3)) * [0.12, 0.07, 0.06] + [0.0, 0.0, 1.3]
    p_B = p_A @ X_BA[:3, :3].T + X_BA[:3, 3]
    seen = (p[:, :2] / p[:, 2:] + noise_px / 600.0 * rng.normal(size=(90, 2)) for p in (p_A, p_B))
    return *seen, X_BA


@pytest.mark.parametrize("seed", [pytest.param(s, marks=pytest.mark.slow) if s > 1 else s
                                  for s in range(40)])  # fmt: skip
def test_points_of_little_depth_tell_the_relative_pose_whatever_is_drawn(seed):
    first, second, X_BA = two_views(seed)
    X_AB, agree = relative_pose(first, second, WITHIN, np.random.default_rng(seed))
    assert agree.mean() > 0.9
    off = rotation_vectors_of(X_AB[:3, :3] @ X_BA[:3, :3])
    assert np.degrees(np.linalg.norm(off)) < 5.0


def test_pairs_that_do_not_belong_together_are_told():
    first, second, _ = two_views(0)
    with pytest.raises(DataError, match="two cameras contradict each other"):
        relative_pose(first, second[::-1], 0.2 * WITHIN, np.random.default_rng(0))


def test_distances_from_epipolar_lines_have_their_derivatives():
    first, second, X = two_views(0, noise_px=3.0)
    E = essential(X[:3, :3], X[:3, 3])
    dE = np.random.default_rng(1).normal(size=(5, 3, 3))
    slope = _sampson(E, first, second, dE)[1]
    h = 1e-6
    for k in range(5):
        ahead, behind = (_sampson(E + sign * h * dE[k], first, second)[0] for sign in (1, -1))
        np.testing.assert_allclose(slope[:, k], (ahead - behind) / (2 * h), rtol=1e-5, atol=1e-8)
