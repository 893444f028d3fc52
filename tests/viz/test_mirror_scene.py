"""What a scene of mirrors shows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.viz.scene.mirror_scene import mirror_scene
from nico_selfmodel.viz.scene.scene import Scene
from nico_selfmodel.viz.scene.surroundings import X_WL


@pytest.fixture(scope="module")
def calibration():
    body = mirror_body(4)
    data = body.watch("near", 10)
    pixels = data.pixels.copy()
    pixels[2] += 30.0
    return calibrate_mirrors(replace(data, pixels=pixels), body.calibrated())


@pytest.fixture(scope="module")
def scene(calibration):
    return mirror_scene(calibration)


def item(scene, path):
    (found,) = scene.under(path)
    return found


def test_the_glass_lies_in_the_plane_that_was_learned(scene, calibration):
    corners = item(scene, "mirrors/near/glass").vertices @ X_WL[:3, :3]
    assert_allclose(calibration.mirrors["near"].in_front_by(corners), 0.0, atol=1e-9)


def test_hand_and_reflection_lie_symmetrically_and_outliers_apart(scene):
    hand = item(scene, "mirrors/near/hand_inliers").centers @ X_WL[:3, :3]
    virtual = item(scene, "mirrors/near/reflection_inliers").centers @ X_WL[:3, :3]
    assert len(hand) == len(virtual) == 9
    assert len(item(scene, "mirrors/near/hand_outliers").centers) == 1
    assert any("outliers" in entry.label for entry in scene.legend)
    gap = virtual - hand
    direction = gap / np.linalg.norm(gap, axis=1)[:, None]
    assert_allclose(direction, np.broadcast_to(direction[0], direction.shape), atol=1e-9)


def test_rays_meet_the_glass_and_leave_as_they_came(scene, calibration):
    normal = X_WL[:3, :3] @ calibration.mirrors["near"].normal
    for camera in ("left", "right"):
        coming = item(scene, f"mirrors/near/rays/{camera}_from_hand")
        going = item(scene, f"mirrors/near/rays/{camera}_to_camera")
        assert_allclose(coming.ends, going.starts)
        into, out = coming.ends - coming.starts, going.ends - going.starts
        into /= np.linalg.norm(into, axis=1)[:, None]
        out /= np.linalg.norm(out, axis=1)[:, None]
        assert_allclose(into - 2.0 * (into @ normal)[:, None] * normal, out, atol=1e-9)


def test_a_scene_of_mirrors_survives_its_file(scene):
    assert Scene.from_json(scene.to_json()).paths == scene.paths
