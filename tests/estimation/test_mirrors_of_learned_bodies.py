"""Flat glass and bent, before robots of world thesis that learned arm and cameras by themselves.

The plain counts keep a slow run short; with NICO_ALL_SEEDS set it takes 25 robots of each kind, 200
flat mirrors in all: `NICO_ALL_SEEDS=1 pytest -m slow -s test_mirrors_of_learned_bodies.py`.
"""

import os
from functools import cache

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.experiments.mirror_body import MIRRORS
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import simulated_scenario
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.systems.simulated.curved_mirror import curved_reflection

from .arms_that_change import THESIS
from .simulated_bodies import Truth

pytestmark = pytest.mark.slow
ALL = bool(os.environ.get("NICO_ALL_SEEDS"))
ROBOTS = range(7600, 7600 + (25 if ALL else 3))
PLACES = {**MIRRORS, "tilted": Mirror.from_values([0.0, np.radians(-20.0), 0.30])}
POSES, PIXEL_SIGMA, MARGIN = 20, 0.3, 15.0


@cache
def learned_body(kind, seed):
    scenario = simulated_scenario(ProjectedNico.tracked_by(), THESIS, seed)
    if kind == "refined":
        return calibrate_body(scenario.train, scenario.cameras, scenario.boards).model
    stereo = StereoPoints.of(
        calibrate_cameras(scenario.boards).self_model("cameras"), scenario.train
    )
    return stereo.complete(calibrate_kinematics(stereo.train, explain=False)).model


def poses_before(mirror, rng):
    """Return angles at which both cameras see the hand in the mirror, 5 cm before both."""
    protocol, found = ProjectedNico.tracked_by(), []
    lower, upper = protocol.arm.lower, protocol.arm.upper
    rig = protocol.workspace.rig
    X_LB, rig = inverse(rig.left.X_WC), rig.moved(rig.left.X_WC)
    largest = np.array([*rig.left.image_size] * 2) - 1.0 - MARGIN
    while sum(map(len, found)) < POSES:
        q = rng.uniform(lower, upper, (4000, len(lower)))
        p = apply(X_LB, protocol.arm.chain.forward(q))
        pixels = MirrorRig(rig, mirror).project(p)
        with np.errstate(invalid="ignore"):
            inside = ((pixels > MARGIN) & (pixels < largest)).all(axis=1)
        found.append(q[inside & (mirror.in_front_by(p) > 0.05) & (p[:, 2] > 0.05)])
    return np.concatenate(found)[:POSES]


def recording(seed, number, mirror, radius=None):
    """Return what a robot sees of its hand in glass, bent about the plane by a radius if any."""
    protocol, rng = ProjectedNico.tracked_by(), np.random.default_rng((seed, number, 77))
    one = protocol.robot(THESIS, seed, 5000 + number)
    q = poses_before(mirror, rng)
    commands = commands_of_angles(one.joints, protocol.arm.lower, protocol.arm.upper, q)
    seen = [(one.move_and_measure(command), one.ground_truth.p_LH) for command in commands]
    p, cameras = np.concatenate([points for _, points in seen]), Truth.of(one).rig
    if radius is None:
        pixels = MirrorRig(cameras, mirror).project(p)
    else:
        shown = [
            curved_reflection(camera, mirror, radius, p, camera.X_WC) for camera in cameras.cameras
        ]
        pixels = np.concatenate(shown, axis=1)
    pixels = pixels + rng.normal(0.0, PIXEL_SIGMA, pixels.shape)
    kept = np.isfinite(pixels).all(axis=1)
    return Dataset(
        "reflections",
        one.joints,
        np.arange(1, kept.sum() + 1),
        np.array([observation.encoders for observation, _ in seen])[kept],
        pixels=pixels[kept],
        mirror=np.full(kept.sum(), "A"),
        marker=np.full(kept.sum(), one.markers[0]),
        pixel_sigma_px=PIXEL_SIGMA,
        image_size=cameras.left.image_size,
    )


def chances(radius):
    """Return by how much chance glass of a radius looks as it does, before every robot."""
    found = {}
    for kind in ("refined", "arm"):
        for seed in ROBOTS:
            for number, (place, mirror) in enumerate(PLACES.items()):
                data = recording(seed, number, mirror, radius)
                flatness = calibrate_mirrors(data, learned_body(kind, seed)).flatness["A"]
                assert flatness is not None
                found[kind, seed, place] = flatness
    return found


def test_flat_mirrors_are_called_flat():
    found = chances(None)
    bent = {key: test.by_chance for key, test in found.items() if not test.flat}
    if ALL:
        print("flat", len(found), "called bent", bent)
    assert len(bent) <= 2 * len(found) // 200, bent
    assert np.mean([test.by_chance < 0.05 for test in found.values()]) < 0.15


@pytest.mark.parametrize("radius", [3.0, -3.0])
def test_a_radius_of_three_metres_is_found(radius):
    found = chances(radius)
    missed = {key: test.by_chance for key, test in found.items() if test.flat}
    if ALL:
        print("radius", radius, len(found), "missed", missed)
    assert len(missed) <= 0.05 * len(found), missed
