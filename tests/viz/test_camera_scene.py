import io

import numpy as np
import pytest
from matplotlib.image import imread

from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.board_items import board_outline
from nico_selfmodel.viz.scene.camera_items import ImagePlane
from nico_selfmodel.viz.scene.camera_scene import X_WL, camera_scene
from nico_selfmodel.viz.scene.scene import FIELD_OF_VIEW, Scene
from nico_selfmodel.viz.scene.scene_items import Picture, Surface

from .seen_boards import OUTLIER, P_GQ, SIZE, photographs


@pytest.fixture(scope="module")
def scene(cameras, photographs):
    return camera_scene(cameras, photographs, name="cameras")


def at(scene, path):
    (item,) = [item for item in scene.items if item.path == path]
    return item


def test_both_cameras_with_images_all_boards_and_one_point_are_there(scene, cameras):
    views = cameras.calibration.views.names
    wanted = {f"boards/{view}/{part}" for view in views for part in ("board", "name")}
    wanted |= {f"cameras/{e}/{p}" for e in ("left", "right") for p in ("image", "outline", "name")}
    wanted |= {"point/epipolar_plane", "point/left_ray", "point/right_ray"}
    wanted |= {"point/left_epipolar_line", "point/right_epipolar_line"}
    assert wanted <= set(scene.paths)
    labels = " ".join(entry.label for entry in scene.legend)
    assert f"boards ({len(views)})" in labels
    assert "left camera" in labels


def test_the_boards_lie_where_they_were_found(scene, cameras):
    for name, X_LG in zip(cameras.calibration.views.names, cameras.calibration.X_LG, strict=True):
        board = at(scene, f"boards/{name}/board")
        found = apply(board.X_WI, board.corners)
        np.testing.assert_allclose(found, board_outline(P_GQ, X_WL @ X_LG), atol=1e-12)


def test_all_inliers_are_in_the_first_view(scene, cameras):
    forward = scene.camera.p_WT - scene.camera.p_WC
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, forward), forward], axis=1)
    outlines = [board_outline(P_GQ, X_WL @ X) for X in cameras.calibration.X_LG]
    x, y, z = ((np.concatenate(outlines) - scene.camera.p_WC) @ axes).T
    half = np.tan(0.5 * FIELD_OF_VIEW)
    assert np.all(z > 0.0)
    assert np.abs(y / z).max() < half
    assert 0.5 * half < np.abs(x / z).max() < 1.5 * half


def test_the_image_shows_each_thing_where_its_ray_goes_through(cameras):
    camera = cameras.calibration.cameras[1]
    plane = ImagePlane(camera, 0.05)
    image = np.full((*SIZE[::-1], 3), 20, dtype=np.uint8)
    u, v = 281, 41
    image[v - 2 : v + 3, u - 2 : u + 3] = [250, 0, 0]
    shown = plane.picture(image).astype(float)
    red = shown[:, :, 0] - shown[:, :, 1]
    rows, columns = np.nonzero(red > 100.0)
    share = np.array([columns.mean() + 0.5, rows.mean() + 0.5]) / shown.shape[1::-1]
    ideal = camera.undistort(np.array([float(u), float(v)]))
    found = (plane.low + share * plane.size) / plane.distance
    np.testing.assert_allclose(found, ideal, atol=1.0 / camera.fx)


def test_the_epipolar_lines_run_through_both_images_of_the_corner(cameras):
    scene = camera_scene(cameras)
    plane = at(scene, "point/epipolar_plane")
    assert isinstance(plane, Surface)
    corners = [apply(X_WL @ X_LG, P_GQ[0]) for X_LG in cameras.calibration.X_LG]
    assert np.linalg.norm(corners - plane.vertices[2], axis=1).min() < 2e-3
    for side, camera in zip(("left", "right"), cameras.calibration.cameras, strict=True):
        line = at(scene, f"point/{side}_epipolar_line").points
        center, outline = X_WL @ camera.X_WC[:, 3], at(scene, f"cameras/{side}/outline").points
        normal = np.cross(*(plane.vertices[1:] - plane.vertices[0]))
        np.testing.assert_allclose((line - center[:3]) @ normal, 0.0, atol=1e-9)
        # The ends lie on the image's edge: outside of no side and on at least one of them.
        x, y = outline[1] - outline[0], outline[3] - outline[0]
        share = np.stack([(line - outline[0]) @ a / (a @ a) for a in (x, y)], axis=1)
        assert np.all((share > -1e-9) & (share < 1.0 + 1e-9))
        np.testing.assert_allclose(np.min([share, 1.0 - share], axis=(0, 2)), 0.0, atol=1e-9)


def test_an_outlier_is_red_and_stands_apart(flawed_cameras):
    scene = camera_scene(flawed_cameras)
    assert [i.path for i in scene.under("outliers")] == [
        f"outliers/{OUTLIER}/board",
        f"outliers/{OUTLIER}/name",
    ]
    board = at(scene, f"outliers/{OUTLIER}/board")
    pixels = imread(io.BytesIO(board.image), format="png")
    np.testing.assert_allclose(pixels[10, 10, :3], palette.rgba(palette.OUTLIER)[:3], atol=0.01)
    assert any(OUTLIER in entry.label for entry in scene.legend)


def test_one_camera_has_no_epipolar_plane_and_without_photographs_there_is_no_image(one_camera):
    scene = camera_scene(one_camera)
    assert scene.under("point") == ()
    assert scene.under("cameras/left") == ()
    assert "cameras/right/image" not in scene.paths
    assert "cameras/right/outline" in scene.paths


def test_the_pictures_in_a_file_are_small_and_come_back(scene):
    again = Scene.from_json(scene.to_json())
    for item, copy in zip(scene.items, again.items, strict=True):
        if isinstance(item, Picture):
            assert len(item.image) < 100_000
            assert copy.image == item.image


def test_a_photograph_of_another_size_is_refused(cameras):
    cut = {
        "left": {n: i[:-1] for n, i in photographs(cameras.calibration.views.names)["left"].items()}
    }
    with pytest.raises(ValueError, match="calibrated for 320 x 240"):
        camera_scene(cameras, cut)
