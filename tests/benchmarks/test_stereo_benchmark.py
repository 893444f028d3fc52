"""Calibrating a pair of cameras against OpenCV: the same corners and parameters, in one run."""

from functools import partial

import cv2
import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.camera_adjustment import Adjustment
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.vision.boards.chessboard import Board

from ..estimation.real_boards import stereo_chessboard
from ..estimation.simulated_boards import boards, pictures
from ..estimation.wide_boards import wide_camera, wide_views
from .timing import best_ratio, fastest

pytestmark = pytest.mark.benchmark
END = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9)


@pytest.fixture(scope="module", params=["real", "simulated"])
def views(request):
    """Return 13 x 54 corners in both cameras."""
    if request.param == "simulated":
        return pictures(boards(13), 0.2)
    return stereo_chessboard(request.getfixturevalue("real_data_folder"))


@pytest.fixture(autouse=True)
def one_thread():
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def opencv_peer(views, tangential):
    """Return OpenCV's own calibration of the pair, from nothing but the corners."""
    board = [views.p_GQ.astype(np.float32)] * len(views)
    left, right = (
        [corners.astype(np.float32)[:, None] for corners in views.of_camera(camera)]
        for camera in views.cameras
    )
    flags = 0 if tangential else cv2.CALIB_ZERO_TANGENT_DIST
    nothing = [None] * 4

    def calibrate():
        return cv2.stereoCalibrate(
            board, left, right, *nothing, views.image_sizes[0], flags=flags, criteria=END
        )

    return calibrate


@pytest.mark.parametrize("tangential", [False, True])
def test_a_pair_costs_no_more_than_opencvs_and_takes_no_longer(views, tangential, benchmark):
    options = CameraOptions(tangential=tangential, loss="none")

    def calibrate():
        return calibrate_cameras(views, options)

    peer = opencv_peer(views, tangential)
    ours, theirs = calibrate(), peer()
    assert ours.converged
    # OpenCV's figure is the root of the mean squared distance over the corners of both cameras.
    corners = views.seen.sum()
    their_cost = 0.5 * theirs[0] ** 2 * corners
    assert ours.cost <= 1.001 * their_cost
    free = {"k1", "k2", "k3", "cx", "cy", "fx", "fy"} | ({"p1", "p2"} if tangential else set())
    assert {name.removeprefix("left.") for name in ours.names if "left" in name} == free
    assert ours.rig.baseline == pytest.approx(np.linalg.norm(theirs[6]), rel=1e-3)
    ratio = best_ratio(calibrate, peer, rounds=12)
    benchmark.extra_info["ratio_to_opencv"] = ratio
    benchmark.extra_info["cost_over_opencvs"] = ours.cost / their_cost
    benchmark(calibrate)
    assert ratio <= 1.2


def opencv_of_one(views, lens):
    """Return OpenCV's own calibration of a camera alone; a fisheye's needs to be told one near."""
    if lens == "fisheye":
        corners = [pixels[None].astype(float) for pixels in views.pixels]
        middle = 0.5 * (np.array(views.image_sizes[0]) - 1.0)
        K = np.array([[380.0, 0.0, middle[0]], [0.0, 380.0, middle[1]], [0.0, 0.0, 1.0]])
        flags = cv2.CALIB_RECOMPUTE_EXTRINSIC + cv2.CALIB_FIX_SKEW
        flags += cv2.CALIB_USE_INTRINSIC_GUESS
        board = [views.p_GQ[None].astype(float)] * len(views)
        return lambda: cv2.fisheye.calibrate(
            board, corners, views.image_sizes[0], K.copy(), np.zeros(4), flags=flags, criteria=END
        )
    flags = cv2.CALIB_ZERO_TANGENT_DIST | (cv2.CALIB_RATIONAL_MODEL if lens == "rational" else 0)
    corners = [p.astype(np.float32)[:, None] for p in views.pixels]
    board = [views.p_GQ.astype(np.float32)] * len(views)
    return lambda: cv2.calibrateCamera(
        board, corners, views.image_sizes[0], None, None, flags=flags, criteria=END
    )


def seen_by_opencv(views):
    """Return views of which OpenCV's fisheyes can make something: near the middle."""
    out = np.linalg.norm(views.pixels - 0.5 * np.array(views.image_sizes[0]), axis=2).max(axis=1)
    return views.select(out < 470.0)


@pytest.mark.parametrize("lens", ["polynomial", "rational", "fisheye"])
def test_one_camera_costs_no_more_than_opencvs_and_takes_no_longer(lens, benchmark):
    ratios = []
    for seed in range(7):
        rng = np.random.default_rng((seed, 5))
        views = wide_views((wide_camera(lens, rng),), rng)
        views = seen_by_opencv(views) if lens == "fisheye" else views
        options = CameraOptions(lens=lens, loss="none")
        peer = opencv_of_one(views, lens)
        ours, theirs = calibrate_cameras(views, options), peer()[0]
        assert ours.rms**2 <= 1.001 * theirs**2
        mine, its = fastest(partial(calibrate_cameras, views, options), peer, rounds=6)
        ratios.append(mine / its)
    benchmark.extra_info["ratio_to_opencv"] = float(np.median(ratios))
    benchmark(partial(calibrate_cameras, views, options))
    assert np.median(ratios) <= 1.2


def test_refining_13_boards_of_54_corners_takes_at_most_50_ms(views, benchmark):
    """Both cameras and all boards at once, from a start that misses by per cents."""
    learned = calibrate_cameras(views)
    left, right = learned.cameras
    rough = [
        type(camera)(
            1.02 * camera.fx, 1.02 * camera.fy, 325.0, 240.0, camera.image_size, X_WC=camera.X_WC
        )
        for camera in (left, right)
    ]
    X_LG = learned.X_LG.copy()
    X_LG[:, 2, 3] *= 1.02
    X_LG[:, 0, 3] += 0.005
    done = []

    def start():
        return (Adjustment(views, tuple(rough), X_LG, CameraOptions()),), {}

    def refine(adjustment):
        adjustment.solve("none")
        done.append(adjustment)

    benchmark.pedantic(refine, setup=start, rounds=15)
    cost = done[-1].solution.solution.cost
    assert cost == pytest.approx(learned.cost, rel=1e-6)
    assert all(each.solution.solution.converged for each in done)
    assert benchmark.stats["min"] <= 50e-3


def test_finding_and_judging_a_pair_takes_at_most_half_more_than_opencvs_and_fits_twice_as_well(
    real_data_folder,
):
    folder = real_data_folder / "stereo_chessboard"
    sides = [
        [cv2.imread(str(path), 0) for path in sorted(folder.glob(f"{side}*.jpg"))]
        for side in ("left", "right")
    ]
    board, size = Board(9, 6, 0.025), (640, 480)
    search = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    places = [board.points.astype(np.float32)] * len(sides[0])
    names = tuple(map(str, range(len(sides[0]))))

    def ours():
        seen = [[board.find(image, 11).corners for image in images] for images in sides]
        pixels = np.concatenate(seen, axis=2)
        views = BoardViews(board.points, names, ("left", "right"), pixels, (size, size))
        return calibrate_cameras(views)

    def opencvs():
        corners = []
        for images in sides:
            found = [cv2.findChessboardCorners(one, (9, 6), flags=search)[1] for one in images]
            for image, each in zip(images, found, strict=True):
                cv2.cornerSubPix(image, each, (11, 11), (-1, -1), (3, 30, 0.1))
            corners.append(found)
        alone = [cv2.calibrateCamera(places, each, size, None, None)[1:3] for each in corners]
        (K, d), (k, e) = alone
        flags = cv2.CALIB_USE_INTRINSIC_GUESS
        return cv2.stereoCalibrate(places, *corners, K, d, k, e, size, flags=flags, criteria=END)

    ratio, fit = best_ratio(ours, opencvs, rounds=3), ours().rms / opencvs()[0]
    print(f"{ratio:.2f} times OpenCV's, fits to {fit:.2f} of what that leaves")
    assert ratio <= 1.5
    assert fit <= 0.5
