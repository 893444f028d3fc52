"""Where a camera sits on a link that moves as is known, from points nobody knows the places of."""

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses import flange_guess
from nico_selfmodel.estimation.tree.guesses.among_unknown import camera_among_unknown
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform

from ..slow_rest import slow_rest
from .simulated_trees import LENS


def sights(seed, poses=60, points=60, turn=0.9, wrong=0.0):
    """Rays of standing points to a camera on a link, and the link's poses."""
    rng = np.random.default_rng(seed)
    R = np.array([rotation_from_vector(turn * w) for w in rng.normal(size=(poses, 3))])
    p = rng.uniform(-0.4, 0.4, (poses, 3))
    X = transform(rotation_from_vector(rng.normal(size=3)), rng.uniform(-0.08, 0.08, 3))
    away = 1.5 * rng.normal(size=(points, 3))[None] - (R @ X[:3, 3] + p)[:, None]
    d = np.einsum("nji,nkj->nki", R @ X[:3, :3], away)
    pose, marker = np.nonzero(d[..., 2] > np.cos(0.5) * np.linalg.norm(d, axis=2))
    rays = d[pose, marker] / d[pose, marker][:, 2:]
    rays[:, :2] += 5e-4 * rng.normal(size=(len(rays), 2))
    mixed = np.where(rng.random(len(marker)) < wrong, rng.integers(0, points, len(marker)), marker)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return X, (rays, mixed, R[pose], p[pose])


@pytest.mark.slow
@pytest.mark.parametrize("seed", slow_rest([0, 1, 2]))
def test_a_camera_among_unknown_points_is_found_from_how_its_link_moves(seed):
    X, seen = sights(seed, wrong=0.02 * seed)
    found = camera_among_unknown(*seen, np.random.default_rng(0))
    assert np.linalg.norm(found[:3, 3] - X[:3, 3]) < 2e-3
    assert np.linalg.norm(found[:3, :3] - X[:3, :3]) < np.radians(0.2)


@pytest.mark.slow
def test_a_camera_that_saw_too_little_is_found_nowhere():
    _, (rays, marker, R, p) = sights(0)
    rng = np.random.default_rng(0)
    assert camera_among_unknown(rays, np.arange(len(rays)), R, p, rng) is None
    assert camera_among_unknown(rays[rng.permutation(len(rays))], marker, R, p, rng) is None


@pytest.mark.parametrize(
    ("poses", "said"),
    [(7, "contradicts the poses of flange 'tcp': check units, which way they go"),
     (6, "needs a sensor that tells whole poses of a target")],
)  # fmt: skip
def test_poses_of_a_flange_are_blamed_where_enough_was_seen(monkeypatch, poses, said):
    monkeypatch.setattr(flange_guess, "_by_unknown", lambda *_: None)
    lens = dict(LENS.named_values)
    count = np.arange(poses)
    data = BodyDataset(
        "flange",
        (LinkJoint("tcp", motion="flange", encoder_unit="pose"),),
        (MarkerInfo("tag", "tcp"),),
        (SensorInfo("eye", "camera", image_size=LENS.image_size, lens=lens),),
        count,
        np.full((poses, 1), np.nan),
        ObservationTable(
            count,
            *(np.zeros(poses, int),) * 2,
            np.full(poses, -1),
            np.hstack([np.full((poses, 2), 200.0), np.full((poses, 4), np.nan)]),
        ),
        np.random.default_rng(0).normal(size=(poses, 1, 6)),
    )
    with pytest.raises(DataError, match=said):
        flange_guess.from_flange(data, None, TreeObservations.of(data), 0)
