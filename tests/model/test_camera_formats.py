"""Files of other programs: written, read back to the same pixels, refused where nothing fits."""

import ast
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.camera_formats.formats import FORMATS, camera_texts, read_cameras
from nico_selfmodel.model.camera_formats.ros_format import rectified_pair
from nico_selfmodel.model.cameras.camera import Camera

INSIDE = {"fx": 610.25, "fy": 612.5, "cx": 322.1, "cy": 236.7, "image_size": (640, 480)}
X_WR = transform(rotation_from_vector([0.02, -0.03, 0.01]), [0.12, 0.003, -0.002])
LENSES = {
    "plain": {"k1": -0.21, "k2": 0.04, "p1": 1e-3, "p2": -2e-3},
    "polynomial": {"k1": -0.21, "k2": 0.04, "k3": -0.004, "p1": 1e-3, "p2": -2e-3},
    "rational": {"k1": 0.8, "k2": 0.1, "k3": 0.01, "k4": 1.1, "k5": 0.3, "k6": 0.02,
                 "lens": "rational"},
    "fisheye": {"k1": 0.03, "k2": -0.01, "k3": 0.003, "k4": -0.0005, "lens": "fisheye"},
}  # fmt: skip
FITS = [
    (kind, lens)
    for kind in FORMATS
    for lens in LENSES
    if not (kind == "kalibr" and lens in ("polynomial", "rational"))
    and not (kind == "mrcal" and lens == "fisheye")
]
THEIRS = """%YAML:1.0
---
image_width: 640
image_height: 480
M1: !!opencv-matrix {data: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0]}
D1: !!opencv-matrix {data: [-0.2, 0.0, 0.0, 0.0]}
M2: !!opencv-matrix {data: [600.0, 0.0, 320.0, 0.0, 600.0, 240.0, 0.0, 0.0, 1.0]}
D2: !!opencv-matrix {data: [-0.2, 0.0, 0.0, 0.0]}
R: !!opencv-matrix {data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]}
T: !!opencv-matrix {data: [-0.1, 0.0, 0.0]}
"""
EDGE = np.stack(np.meshgrid([-0.4, 0.0, 0.4], [-0.3, 0.0, 0.3], [1.0, 2.0]), axis=-1).reshape(-1, 3)


def pair(lens):
    left = Camera(**INSIDE, **LENSES[lens])
    right = Camera(**(INSIDE | {"fx": 608.0, "cx": 318.0}), **LENSES[lens], X_WC=X_WR)
    return {"left": left, "right": right}


def written(folder, cameras, kind):
    paths = []
    for name, text in camera_texts(cameras, kind).items():
        (folder / name).write_text(text)
        paths.append(folder / name)
    return paths


@pytest.mark.parametrize(("kind", "lens"), FITS)
def test_cameras_are_read_back_to_the_same_pixels(tmp_path, kind, lens):
    cameras = pair(lens)
    paths = written(tmp_path, cameras, kind)
    found = read_cameras(paths)
    for side, camera in cameras.items():
        assert found[side].lens == camera.lens
        assert found[side].project(EDGE) == pytest.approx(camera.project(EDGE), abs=1e-9)
    alone = tmp_path / "alone"
    alone.mkdir()
    (path,) = written(alone, {"left": cameras["left"]}, kind)
    one = read_cameras([path])
    assert one["left"].project(EDGE) == pytest.approx(cameras["left"].project(EDGE), abs=1e-9)


def different():
    """Return a fisheye, and a polynomial without k3 with smaller images."""
    left, right = pair("fisheye")["left"], pair("plain")["right"]
    return {"left": left, "right": replace(right, image_size=(600, 460))}


def test_cameras_of_two_kinds_are_read_back_where_a_file_has_a_place_for_each(tmp_path):
    cameras = different()
    found = read_cameras(written(tmp_path, cameras, "kalibr"))
    for side, camera in cameras.items():
        assert (found[side].lens, found[side].image_size) == (camera.lens, camera.image_size)
        assert found[side].project(EDGE) == pytest.approx(camera.project(EDGE), abs=1e-9)
    mixed = {"left": pair("plain")["left"], "right": pair("rational")["right"]}
    for kind in ("opencv", "mrcal"):
        (tmp_path / kind).mkdir()
        found = read_cameras(written(tmp_path / kind, mixed, kind))
        for side, camera in mixed.items():
            assert found[side].lens == camera.lens
            assert found[side].project(EDGE) == pytest.approx(camera.project(EDGE), abs=1e-9)


@pytest.mark.parametrize("kind", ["opencv", "opencv-json"])
def test_opencvs_file_refuses_cameras_for_which_it_has_one_place(kind):
    cameras = different()
    alike = replace(cameras["right"], image_size=cameras["left"].image_size)
    for other in (alike, replace(pair("fisheye")["right"], image_size=(600, 460))):
        with pytest.raises(ModelError, match="one image size, and fisheyes alone or none"):
            camera_texts({"left": cameras["left"], "right": other}, kind)


@pytest.mark.parametrize("kind", ["opencv", "opencv-json"])
def test_opencvs_own_reader_reads_what_is_written(tmp_path, kind):
    cameras = pair("rational")
    (path,) = written(tmp_path, cameras, kind)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("M1").mat() == pytest.approx(cameras["left"].K)
    k = storage.getNode("D2").mat().ravel()
    assert k.tolist() == [0.8, 0.1, 0.0, 0.0, 0.01, 1.1, 0.3, 0.02]
    R, T = storage.getNode("R").mat(), storage.getNode("T").mat()
    p_R, _ = cv2.projectPoints(EDGE, cv2.Rodrigues(R)[0], T, storage.getNode("M2").mat(), k)
    assert p_R[:, 0] == pytest.approx(cameras["right"].project(EDGE), abs=1e-6)


def test_what_opencv_writes_is_read(tmp_path):
    path = tmp_path / "theirs.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    camera = Camera(**INSIDE, **LENSES["polynomial"])
    for name, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", camera.K)):
        storage.write(name, value)
    k = camera.k
    storage.write("distortion_coefficients", np.array([[*k[:2], *camera.p, k[2]]]))
    storage.release()
    found = read_cameras([path])["left"]
    assert found.project(EDGE) == pytest.approx(camera.project(EDGE), abs=1e-9)


@pytest.mark.parametrize("lens", ["rational", "fisheye"])
def test_the_two_files_of_opencvs_stereo_sample_are_one_pair(tmp_path, lens):
    cameras = pair(lens)
    (path,) = written(tmp_path, cameras, "opencv")
    text = path.read_text()
    place = text.index("R: !!")
    (tmp_path / "intrinsics.yml").write_text(text[:place])
    (tmp_path / "extrinsics.yml").write_text("%YAML:1.0\n---\n" + text[place:])
    for names in (("intrinsics", "extrinsics"), ("extrinsics", "intrinsics")):
        found = read_cameras([tmp_path / f"{name}.yml" for name in names])
        for side, camera in cameras.items():
            assert found[side].project(EDGE) == pytest.approx(camera.project(EDGE), abs=1e-9)
    (tmp_path / "intrinsics.yml").write_text(text[:place].replace("image_width", "width"))
    with pytest.raises(DataError, match=r"intrinsics.yml and .*size of its images is missing"):
        read_cameras([tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"])


def test_mrcals_fields_are_as_documented():
    texts = camera_texts(pair("polynomial"), "mrcal")
    right = ast.literal_eval(texts["right.cameramodel"])
    assert right["lensmodel"] == "LENSMODEL_OPENCV5"
    assert right["intrinsics"][:4] == [608.0, 612.5, 318.0, 236.7]
    assert right["intrinsics"][4:] == [-0.21, 0.04, 1e-3, -2e-3, -0.004]
    turn = rotation_from_vector(np.array(right["extrinsics"][:3]))
    assert turn @ X_WR[:3, 3] + right["extrinsics"][3:] == pytest.approx(np.zeros(3), abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        ("kalibr", LENSES["polynomial"], "k3 to k6 has no counterpart in Kalibr"),
        ("kalibr", LENSES["rational"], "k3 to k6 has no counterpart in Kalibr"),
        ("mrcal", LENSES["fisheye"], "a fisheye has no counterpart in mrcal"),
        ("ros", {"skew": 0.5}, "skew 0.5 px has no counterpart in ROS"),
        ("opencv", {"skew": 0.5}, "skew 0.5 px has no counterpart in OpenCV"),
    ],
)
def test_a_camera_without_counterpart_is_refused(kind, change, words):
    with pytest.raises(ModelError, match=words):
        camera_texts({"left": Camera(**INSIDE, **change)}, kind)


ROS_LEFT = camera_texts({"left": Camera(**INSIDE)}, "ros")["left.yaml"]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.yaml", "x: 1\n", "holds no cameras of opencv"),
        ("a.yaml", "[1, 2]\n", "holds no cameras"),
        ("a.cameramodel", "{'lensmodel': ", "it does not parse"),
        ("a.cameramodel", "__import__('os')", "it does not parse"),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_CAHVORE'}", "has no counterpart"),
        ("a.cameramodel", "{'lensmodel': 'LENSMODEL_PINHOLE', 'intrinsics': [1, 2]}", "intrinsics"),
        ("a.yaml", "distortion_model: thin\n", "distortion_model 'thin' has no counterpart"),
        ("a.yaml", "distortion_model: plumb_bob\n", "'camera_matrix' is missing"),
        ("a.yaml", ROS_LEFT.replace("projection_", "p_"), "'projection_matrix' is missing"),
        (
            "a.yaml",
            ROS_LEFT.replace("image_width: 640\n", ""),
            "size of its images is missing: add",
        ),
        ("a.yaml", "cam0: {camera_model: omni}\n", "only pinhole has"),
        ("a.yaml", "cam0: 3\n", "expected a camera"),
        ("a.yaml", "cam7: {}\n", "expected cam0, got cam7"),
        ("a.json", '{"M1": {"data": [1, 2]}}', "M1: expected"),
        ("a.yaml", THEIRS.replace("[1.0, 0.0", "[1.2, 0.0"), "is no rotation and translation"),
        ("a.yaml", THEIRS.replace("-0.2", "wide"), "D1: expected"),
    ],
)
def test_files_that_are_none_are_refused(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=words) as error:
        read_cameras([tmp_path / name])
    assert "\n" not in str(error.value)
    assert name in str(error.value)


def test_a_principal_point_outside_the_images_is_warned_of(tmp_path):
    (tmp_path / "a.yaml").write_text(ROS_LEFT.replace("image_width: 640", "image_width: 300"))
    with pytest.warns(UserWarning, match=r"point 322.1, 236.7 lies outside images of 300 x 480"):
        read_cameras([tmp_path / "a.yaml"])


@pytest.mark.parametrize("kind", ["kalibr", "mrcal"])
def test_a_rig_of_three_keeps_its_places(tmp_path, kind):
    cameras = pair("fisheye" if kind == "kalibr" else "plain")
    third = cameras["right"].at(X_WR @ X_WR)
    rig = dict(zip(("cam0", "cam1", "cam2"), (*cameras.values(), third), strict=True))
    found = read_cameras(written(tmp_path, rig, kind))
    assert list(found) == list(rig)
    for name, camera in rig.items():
        assert found[name].project(EDGE) == pytest.approx(camera.project(EDGE), abs=1e-9)
    with pytest.raises(ModelError, match="3 cameras have no counterpart in OpenCV's files"):
        camera_texts(rig, "opencv")


@pytest.mark.parametrize("lens", ["polynomial", "fisheye"])
def test_both_of_ros_rectified_cameras_see_a_point_in_the_same_row(lens):
    cameras = pair(lens)
    files = [yaml.safe_load(text) for text in camera_texts(cameras, "ros").values()]
    seen = []
    for document, camera in zip(files, cameras.values(), strict=True):
        R = np.reshape(document["rectification_matrix"]["data"], (3, 3))
        P = np.reshape(document["projection_matrix"]["data"], (3, 4))
        p_C = EDGE @ camera.X_CW[:3, :3].T + camera.X_CW[:3, 3]
        flat = p_C @ R.T @ P[:, :3].T
        seen.append(flat[:, :2] / flat[:, 2:])
    assert P[0, 3] == pytest.approx(-P[0, 0] * np.linalg.norm(X_WR[:3, 3]))
    assert seen[0][:, 1] == pytest.approx(seen[1][:, 1], abs=1e-9)
    assert (seen[0][:, 0] > seen[1][:, 0]).all()


@pytest.mark.parametrize(
    ("turn", "place"), [(2.5, (0.0, 0.1, 0.0)), (0.1, (0.0, 0.0, 0.0)), (0.0, (0.0, 0.0, 0.1))]
)
def test_two_cameras_that_cannot_be_rectified_are_no_pair_of_ros(tmp_path, turn, place):
    """One looks almost against the other, both stand in one place, one before the other."""
    X = transform(rotation_from_vector([0.0, turn, 0.0]), place)
    cameras = pair("plain") | {"right": pair("plain")["right"].at(X)}
    with pytest.raises(DataError, match="put both cameras in one place"):
        read_cameras(written(tmp_path, cameras, "ros"))


@pytest.mark.parametrize(("degrees", "told"), [(58.0, True), (62.0, False)])
def test_a_pair_is_rectified_up_to_60_degrees_aside(degrees, told):
    """Cameras above each other that look as far to either side."""
    cameras = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        R = rotation_from_vector([0.0, sign * np.radians(degrees), 0.0])
        cameras[side] = pair("plain")[side].at(transform(R, [0.0, 0.1 * sign, 0.0]))
    assert (rectified_pair(cameras) is not None) == told


def test_what_no_file_can_hold_is_refused():
    with pytest.raises(ValueError, match="no format 'tum'; there are opencv"):
        camera_texts(pair("plain"), "tum")
    with pytest.raises(ModelError, match="has no camera"):
        camera_texts({}, "opencv")
