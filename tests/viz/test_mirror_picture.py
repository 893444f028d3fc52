"""What a camera saw in a mirror, drawn on the glass."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.vision.images.image_file import write_image
from nico_selfmodel.viz.scene.mirror_picture import MirrorPicture, on_glass, recorded_pictures
from nico_selfmodel.viz.scene.mirror_scene import mirror_scene


@pytest.fixture(scope="module")
def seen():
    body = mirror_body(4)
    return body.watch("near", 8), body.calibrated()


def grey(value=120):
    return np.full((480, 640, 3), value, np.uint8)


def decoded(picture, tmp_path):
    from matplotlib.image import imread

    path = tmp_path / "picture.jpg"
    path.write_bytes(picture.image)
    return imread(path)


def test_a_spot_on_the_glass_is_painted_where_the_camera_sees_it(tmp_path):
    camera = Camera(380.0, 380.0, 320.0, 240.0, (640, 480), k1=-0.2)
    corners = np.array([[-0.2, 0.1, 0.4], [0.2, 0.1, 0.4], [0.2, -0.1, 0.4], [-0.2, -0.1, 0.4]])
    spot = np.array([0.11, -0.04, 0.4])
    image = grey()
    u, v = np.rint(camera.project(spot)).astype(int)
    image[v - 4 : v + 5, u - 4 : u + 5] = (255, 0, 0)
    picture = on_glass("glass", camera, corners, image)
    assert_allclose([picture.width, picture.height], [0.4, 0.2])
    shown = decoded(picture, tmp_path).astype(int)
    rows, columns = np.nonzero((shown[:, :, 0] > 200) & (shown[:, :, 1] < 80))
    step = picture.width / shown.shape[1]
    x = (columns.mean() + 0.5) * step - 0.5 * picture.width
    y = (rows.mean() + 0.5) * step - 0.5 * picture.height
    assert_allclose(apply(picture.X_WI, np.array([x, y, 0.0])), spot, atol=1e-3)
    # Right and down as the camera has them: it looks along z of the picture.
    assert_allclose(picture.X_WI[:3, :3], np.eye(3), atol=1e-12)


def test_the_glass_of_a_scene_carries_the_picture_and_rays_go_to_its_hand(seen):
    data, model = seen
    found = calibrate_mirrors(data, model)
    picture = MirrorPicture(int(data.sample[3]), data.encoders[3], (grey(), grey()))
    scene = mirror_scene(found, {"near": picture})
    assert len(scene.under("mirrors/near/picture")) == 1
    (ray,) = scene.under("mirrors/near/rays/left_from_hand")
    assert len(ray.starts) == 1
    X_SL = scene.under("mirrors/near/picture") and np.array(
        [[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]
    )
    (p,) = model.predict(data.encoders[3]).p_WH
    assert_allclose(ray.starts[0], apply(X_SL @ model.rig.left.X_CW, p), atol=1e-9)
    plain = mirror_scene(found)
    assert not plain.under("mirrors/near/picture")


@pytest.mark.slow
def test_the_robot_stands_upright_before_its_mirror(seen):
    data, model = seen
    arm = ArmDescription.named("nico")
    model = replace(model, robot=arm.source)
    found = calibrate_mirrors(data, model)
    picture = MirrorPicture(int(data.sample[0]), data.encoders[0], (grey(), grey()))
    scene = mirror_scene(found, {"near": picture}, arm)
    assert scene.under("robot")
    (hand,) = scene.under("mirrors/near/hand_inliers")
    (glass,) = scene.under("mirrors/near/glass")
    # The robot looks along x: its hand is this side of the glass.
    assert hand.centers[:, 0].max() < glass.vertices[:, 0].max()


def test_pictures_of_a_recording_are_found_by_their_pose(seen, tmp_path):
    data, _ = seen
    poses = tuple(str(k + 1) for k in range(len(data)))
    data = replace(data, extra={"pose": poses})
    assert recorded_pictures(tmp_path, data) == {}
    (tmp_path / "images").mkdir()
    for camera, shade in (("left", 40), ("right", 80)):
        write_image(tmp_path / "images" / f"{camera}0003.png", grey(shade))
    found = recorded_pictures(tmp_path, data)
    assert list(found) == ["near"]
    assert found["near"].sample == int(data.sample[2])
    left, right = found["near"].images
    assert (left == 40).all()
    assert (right == 80).all()


def test_a_turned_glass_keeps_its_picture_upright():
    turn = transform(np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3))
    camera = Camera(380.0, 380.0, 320.0, 240.0, (640, 480), X_WC=turn)
    corners = apply(
        turn, np.array([[-0.2, 0.1, 0.4], [0.2, 0.1, 0.4], [0.2, -0.1, 0.4], [-0.2, -0.1, 0.4]])
    )
    picture = on_glass("glass", camera, corners, grey())
    assert_allclose(picture.X_WI[:3, :3], turn[:3, :3], atol=1e-12)
