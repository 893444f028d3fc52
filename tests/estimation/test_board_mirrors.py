"""An camera and mirrors from boards seen directly and in the mirrors, simulated and real."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.dataset.mirrored_boards import MirroredBoards
from nico_selfmodel.errors import DataError, EstimationError, NotIdentifiableError
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.mirrors.board_mirror_residuals import BoardMirrorResiduals
from nico_selfmodel.estimation.mirrors.board_mirrors import calibrate_board_mirrors, place_boards
from nico_selfmodel.estimation.mirrors.board_reflections import board_reflections
from nico_selfmodel.estimation.mirrors.mirror_evaluation import MirrorEvaluation
from nico_selfmodel.estimation.mirrors.mirror_solution import solve_mirrors, start_mirrors
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model_file import load_model, save_model

SIZE = (1600, 1200)
EYE = Camera(1500.0, 1495.0, 790.0, 610.0, SIZE, k1=-0.11, k2=0.08)
WALLS = {
    "left": Mirror.from_values([np.radians(42.0), np.radians(3.0), 0.50]),
    "right": Mirror.from_values([np.radians(-48.0), np.radians(-2.0), 0.62]),
}
GRID = np.stack(np.meshgrid(np.arange(7.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
P_GQ = 0.02 * np.column_stack([GRID - GRID.mean(axis=0), np.zeros(len(GRID))])


def boards(count=10, sigma=0.2, seed=0):
    """Return photographs of a board in a corner of two mirrors, and where it was."""
    rng, seen, poses = np.random.default_rng(seed), [], []
    while len(seen) < count:
        turn = rotation_from_vector(rng.normal(0.0, 0.35, 3))
        pose = transform(turn, rng.uniform([-0.12, -0.05, 0.42], [0.12, 0.12, 0.58]))
        corners = apply(pose, P_GQ)
        points = [corners, *(wall.reflect(corners) for wall in WALLS.values())]
        front = all(wall.in_front_by(corners).min() > 0.0 for wall in WALLS.values())
        pixels = np.array([EYE.project(p) for p in points])
        inside = ((pixels > 5.0) & (pixels < np.array(SIZE) - 6.0)).all(axis=(1, 2))
        if front and inside[0] and inside[1:].any():
            pixels[~inside] = np.nan
            seen.append(pixels + rng.normal(0.0, sigma, pixels.shape))
            poses.append(pose)
    names = tuple(f"{k:02d}" for k in range(count))
    return MirroredBoards(P_GQ, names, tuple(WALLS), np.array(seen), SIZE), np.array(poses)


@pytest.fixture(scope="module")
def calibrated():
    views, poses = boards()
    return views, poses, calibrate_board_mirrors(views, CameraOptions(pinned={"k3": 0.0}))


def test_exact_corners_give_back_camera_mirrors_and_boards():
    views, poses = boards(6, sigma=0.0)
    found = calibrate_board_mirrors(views, CameraOptions(pinned={"k3": 0.0}))
    assert found.converged
    assert found.rms < 1e-6
    assert_allclose(found.camera.values, EYE.values, rtol=1e-6, atol=1e-6)
    for name, wall in WALLS.items():
        assert_allclose(found.mirrors[name].values, wall.values, atol=1e-8)
    assert_allclose(found.X_LG, poses, atol=1e-7)


def test_noise_is_found_again_and_sigmas_are_honest(calibrated):
    views, _, found = calibrated
    assert found.rms == pytest.approx(0.2 * np.sqrt(2.0), rel=0.1)
    scores = []
    for name, wall in WALLS.items():
        miss = found.mirrors[name].values - wall.values
        scores.append(miss @ np.linalg.solve(found.mirrors[name].covariance, miss) / 3.0)
    assert np.max(scores) < 5.0
    angle, sigma = found.angle_between("left", "right")
    assert abs(angle - WALLS["left"].angle_to(WALLS["right"])) < 4.0 * sigma
    assert 0.0 < sigma < np.radians(0.1)
    assert len(views) == 10


def test_derivatives_are_finite_differences(calibrated):
    views, _, found = calibrated
    few = views.select([0, 1, 2])
    block = BoardMirrorResiduals(few, found.X_LG[:3], 0.2)
    x = block.start_of(found.camera, tuple(found.mirrors.values()), found.X_LG[:3])
    x = x + 1e-3 * np.random.default_rng(0).normal(size=len(x)) * (np.abs(x) < 1.0)
    r, jacobian = block.evaluate(x)
    assert jacobian.shape == (len(block.names), *r.shape)
    for k in range(len(x)):
        step = 1e-6 * max(1.0, abs(x[k]))
        change = step * np.eye(len(x))[k]
        slope = (block.residuals(x + change) - block.residuals(x - change)) / (2.0 * step)
        assert_allclose(jacobian[k], slope, rtol=1e-4, atol=2e-3 * max(1.0, np.abs(slope).max()))


def test_a_board_seen_in_mirrors_alone_is_placed_too():
    views, poses = boards(8, sigma=0.0)
    pixels = views.pixels.copy()
    row = int(np.flatnonzero(np.isfinite(pixels[:, 1]).all(axis=(1, 2)))[0])
    pixels[row, 0] = np.nan
    found = calibrate_board_mirrors(
        replace(views, pixels=pixels), CameraOptions(pinned={"k3": 0.0})
    )
    assert_allclose(found.X_LG[row], poses[row], atol=1e-6)


def test_a_photograph_of_another_board_is_set_aside(calibrated):
    views, _, _ = calibrated
    pixels = views.pixels.copy()
    pixels[3] += np.random.default_rng(1).normal(0.0, 12.0, pixels[3].shape)
    found = calibrate_board_mirrors(
        replace(views, pixels=pixels), CameraOptions(pinned={"k3": 0.0})
    )
    assert np.flatnonzero(found.outliers).tolist() == [3]
    for name, wall in WALLS.items():
        assert np.degrees(found.mirrors[name].angle_to(wall)) < 0.2


def test_the_result_is_a_self_model_that_survives_the_round_trip(calibrated, tmp_path):
    _, _, found = calibrated
    save_model(found.self_model("corner", {"images": "simulated"}), tmp_path / "model.yaml")
    model = load_model(tmp_path / "model.yaml")
    assert tuple(model.mirrors) == ("left", "right")
    assert "mirror.left.tilt_x" in model.covariance.names
    assert model.provenance["images"] == "simulated"


def test_direct_views_as_a_body_tell_the_mirrors_by_reflections_alone(calibrated):
    views, _, _ = calibrated
    reflections = board_reflections(views, EYE, 0.2)
    noise = ReflectionNoise(0.2, 0.0)
    solution = solve_mirrors(reflections, start_mirrors(reflections), noise)
    for name, mirror in zip(views.mirrors, solution.mirrors, strict=True):
        miss = mirror.values - WALLS[name].values
        assert np.degrees(mirror.angle_to(WALLS[name])) < 0.5
        assert miss @ np.linalg.solve(mirror.covariance, miss) / 3.0 < 5.0


def test_boards_are_placed_with_their_uncertainty():
    views, poses = boards(6, sigma=0.2, seed=4)
    X_LG, covariance = place_boards(views, EYE)
    scores = []
    for found, true, spread in zip(X_LG, poses, covariance, strict=True):
        turn = found[:3, :3] @ true[:3, :3].T
        vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0],
                                 turn[1, 0] - turn[0, 1]])  # fmt: skip
        miss = np.concatenate([vector, found[:3, 3] - true[:3, 3]])
        scores.append(miss @ np.linalg.solve(0.2**2 * spread, miss) / 6.0)
    assert 0.3 < np.mean(scores) < 2.5


def test_what_cannot_be_learned_is_said():
    views, _ = boards(8)
    pixels = views.pixels.copy()
    pixels[2:, 0] = np.nan
    with pytest.raises(NotIdentifiableError, match="2 photographs show the board directly"):
        calibrate_board_mirrors(replace(views, pixels=pixels))
    pixels = views.pixels.copy()
    pixels[:, 2] = np.nan
    with pytest.raises(NotIdentifiableError, match="in mirror 'right'"):
        calibrate_board_mirrors(replace(views, pixels=pixels))
    pixels = views.pixels.copy()
    # Corners listed as they appear, not as they are on the board: mirrored left to right.
    pixels[:, 1:] = pixels[:, 1:].reshape(8, 2, 5, 7, 2)[:, :, :, ::-1].reshape(8, 2, 35, 2)
    with pytest.raises(DataError, match="in the board's own order"):
        calibrate_board_mirrors(replace(views, pixels=pixels))
    # A mirror that turned by three degrees between the photographs.
    pixels = views.pixels.copy()
    pixels[:4, 1] += [60.0, -20.0]
    with pytest.raises(EstimationError, match="did they keep still") as caught:
        calibrate_board_mirrors(replace(views, pixels=pixels), CameraOptions(loss="none"))
    assert caught.value.partial.rms > 3.0


def test_options_that_are_not_supported_are_refused():
    views, _ = boards(4)
    with pytest.raises(ValueError, match="not supported"):
        calibrate_board_mirrors(views, CameraOptions(aspect=1.0))
    undirect, unmirrored = views.pixels.copy(), views.pixels.copy()
    undirect[0, 0] = np.nan
    unmirrored[:, 1:] = np.nan
    with pytest.raises(DataError, match="directly"):
        place_boards(replace(views, pixels=undirect), EYE)
    with pytest.raises(DataError, match="no photograph shows a reflection"):
        board_reflections(replace(views, pixels=unmirrored), EYE)


def test_mirrored_boards_check_themselves():
    views, _ = boards(3)
    with pytest.raises(ValueError, match="pixels must have shape"):
        replace(views, pixels=views.pixels[:, :2])
    with pytest.raises(ValueError, match="unique"):
        replace(views, mirrors=("left", "left"))
    assert views.select([1]).names == ("01",)
    assert views.directly().cameras == ("left",)


# ------------------------------------------------------------------------------- the real corner


@pytest.fixture(scope="module")
def corner(real_data_folder):
    path = real_data_folder / "planar_mirrors" / "derived_corners.npz"
    if not path.is_file():
        pytest.skip(f"no {path}")
    data = np.load(path)
    names = tuple(f"{k:02d}" for k in range(1, 12))
    pixels = np.full((11, 3, 42, 2), np.nan)
    for v, name in enumerate(names):
        for way, key in enumerate("DLR"):
            if f"{name}_{key}" in data.files:
                pixels[v, way] = data[f"{name}_{key}"]
    # Squares of 30 mm stand for any: angles and pixels do not depend on it.
    return MirroredBoards(0.03 * data["model"], names, ("left", "right"), pixels, (3264, 1470))


@pytest.mark.real_data
def test_a_real_corner_of_mirrors_is_right_angled(corner):
    found = calibrate_board_mirrors(corner, CameraOptions(pinned={"k3": 0.0}))
    angle, sigma = found.angle_between("left", "right")
    assert found.converged
    assert found.rms <= 0.56
    assert 89.9 <= np.degrees(angle) <= 90.1
    assert np.degrees(sigma) < 0.05
    assert not found.outliers.any()


@pytest.mark.real_data
def test_real_reflections_are_predicted_from_direct_views_alone(corner):
    from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras

    errors, expected = [], []
    for fold in range(5):
        held = np.arange(len(corner)) % 5 == fold
        train, test = corner.select(~held), corner.select(held)
        (camera,) = calibrate_cameras(train.directly(), CameraOptions(pinned={"k3": 0.0})).cameras
        reflections = board_reflections(train, camera)
        found = solve_mirrors(
            reflections, start_mirrors(reflections), ReflectionNoise(0.5, 0.0)
        ).mirrors
        shown = MirrorEvaluation.from_reflections(board_reflections(test, camera), found)
        errors.append(shown.distances_px)
        expected.append(np.degrees(found[0].angle_to(found[1])))
    # What limits it is how badly one camera places a board along its line of sight, and a lens
    # known from direct views alone: 1.1 px remain with the lens from all views.
    assert np.concatenate(errors).mean() <= 3.0
    assert np.abs(np.array(expected) - 90.0).max() < 1.0
