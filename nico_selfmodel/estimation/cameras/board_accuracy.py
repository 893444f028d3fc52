"""How well calibrated cameras do: held-out boards, epipolar lines, reconstructed squares."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.camera_adjustment import Adjustment, CameraCalibration
from nico_selfmodel.estimation.cameras.camera_calibration import FEWEST_VIEWS, cameras_of_fewer
from nico_selfmodel.estimation.cameras.camera_initialization import pose_of_seen_boards
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.rig_start import rig_links
from nico_selfmodel.estimation.results.folds import cross_validate, fold_of, splits
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Boards rebuilt from pixels alone by triangulation, held against their true shape."""

    views: tuple[str, ...]
    """Views that both cameras saw whole, and whose sights meet. Length V."""
    p_LQ: NDArray
    """Corners in the left camera's frame [m]. Shape (V, P, 3)."""
    errors: NDArray
    """Distances from the true board, laid onto the points rigidly [m]. Shape (V, P)."""
    scale: NDArray
    """Size of each rebuilt board over its true one, by similarity alignment. Shape (V,)."""
    edges: NDArray
    """Lengths of all edges of all squares [m]. Shape (E,)."""
    square: float
    """True length of an edge [m]."""

    @property
    def edge_sd(self) -> float:
        """Standard deviation of the edges, the thesis' measure of a stereo pair [m]."""
        return float(self.edges.std(ddof=1))

    @property
    def depths(self) -> NDArray:
        """Distance of each corner from the left camera [m]. Shape (V, P)."""
        return np.linalg.norm(self.p_LQ, axis=2)

    @classmethod
    def from_views(cls, rig: StereoRig, views: BoardViews) -> "Reconstruction":
        """Triangulate every board that both cameras saw whole.

        The scale is a similarity's (Umeyama): a mean of edge lengths is biased by noise. A board of
        which sights meet nowhere, as where a lens is extrapolated, cannot be rebuilt: it is left
        out.

        Returns:
            The rebuilt boards; none where no board was seen whole by both.
        """
        whole = views.select(views.seen.all(axis=(1, 2)))
        points = whole.p_GQ
        p = rig.triangulate(whole.pixels.reshape(-1, 4)).p_WQ.reshape(-1, len(points), 3)
        met = np.isfinite(p).all(axis=(1, 2))
        whole, p = whole.select(met), p[met]
        rigid = [Alignment.from_points(points, found) for found in p]
        scale = [Alignment.from_points(points, found, with_scale=True).scale for found in p]
        laid = np.array([a.apply(points) for a in rigid]).reshape(p.shape)
        first, second, square = _edges(points)
        edges = np.linalg.norm(p[:, first] - p[:, second], axis=2).ravel()
        errors = np.linalg.norm(p - laid, axis=2)
        return cls(whole.names, p, errors, np.array(scale), edges, square)


def held_out_residuals(
    cameras: tuple[Camera, ...], views: BoardViews, near: NDArray | None = None
) -> NDArray:
    """Return what boards that were not learned from leave unexplained.

    Only the pose of each board is fitted, the cameras stay.

    Args:
        cameras: The calibrated cameras, the first one at the world.
        views: Other views, of the same cameras.
        near: Poses of the boards to begin with; found anew if omitted. Shape (V, 4, 4).

    Returns:
        Measured minus predicted pixels, nan where not seen. Shape (V, P, 2 C).

    Raises:
        EstimationError: If a board's pose cannot be found.
    """
    lenses = {name: camera.lens for name, camera in zip(views.cameras, cameras, strict=True)}
    options = CameraOptions(tangential=True, freed=frozenset(["skew"]), loss="none", lens=lenses)
    start = pose_of_seen_boards(cameras, views) if near is None else near
    adjustment = Adjustment(views, cameras, start, options)
    for name in adjustment.block.shared_names:
        adjustment.program.fix(name)
    adjustment.solve("none")
    return adjustment.block.pixel_residuals(adjustment.block.evaluate_parts(adjustment.x)[0])


def cross_validate_cameras(
    calibration: CameraCalibration, options: CameraOptions, inliers: NDArray
) -> NDArray:
    """Calibrate five times without a fifth of the boards, and return what these leave.

    Each begins at the cameras that all boards told, which are near: `cameras_of_fewer`.

    Args:
        inliers: Views that count. Boolean, shape (V,).

    Returns:
        Measured minus predicted pixels of each inlier, shape (n, P, 2 C); empty with too few
        boards.
    """
    views = calibration.views
    kept = views.select(inliers)
    fold = _folds(kept)
    if not fold.size or not all(_suffices(kept.select(part.rest)) for part in splits(fold)):
        return np.zeros((0, len(views.p_GQ), 2 * len(views.cameras)))
    X_LG = calibration.X_LG[inliers]
    return cross_validate(
        fold,
        lambda part: cameras_of_fewer(calibration, kept.select(part.rest), options),
        lambda cameras, part: held_out_residuals(cameras, kept.select(part.left), X_LG[part.left]),
    )


def _folds(views: BoardViews) -> NDArray:
    """Return the fold of each view: each fold has views of all parts of a rig."""
    fold = fold_of(np.arange(len(views)))
    saw = views.seen.any(axis=2) @ (1 << np.arange(len(views.cameras)))
    found = np.empty_like(fold)
    found[np.argsort(saw, kind="stable")] = fold
    return found


def _suffices(views: BoardViews) -> bool:
    """Tell whether cameras can be learned from some views: enough of each, all connected."""
    try:
        rig_links(views)
    except EstimationError:
        return False
    return bool((views.seen.any(axis=2).sum(axis=0) >= FEWEST_VIEWS).all())


@dataclass(frozen=True, eq=False)
class PairAccuracy:
    """What two cameras of a rig do together."""

    cameras: tuple[str, str]
    """Their names."""
    boards: int
    """How many of the boards learned from both saw."""
    epipolar: NDArray
    """Distances from epipolar lines in both images, nan where not seen [px]. Shape (V, P, 2)."""
    reconstruction: Reconstruction
    """Boards rebuilt by triangulation; the held-out ones where there are some."""

    @classmethod
    def of(
        cls, calibration: CameraCalibration, link: tuple[str, str], shown: BoardViews
    ) -> "PairAccuracy":
        """Hold two cameras against the boards that both saw.

        Args:
            link: Two of its cameras.
            shown: The boards that are rebuilt.
        """
        rig, views = calibration.pair(*link), calibration.views.pair(*link)
        both = np.all(views.seen.any(axis=2), axis=1) & ~calibration.outliers
        part = shown.pair(*link)
        rays = have_rays(rig, part.pixels.reshape(-1, 4)).reshape(len(part), -1)
        rebuilt = Reconstruction.from_views(rig, part.select(rays.all(axis=1)))
        return cls(link, int(both.sum()), epipolar_errors(rig, views), rebuilt)


def pairs_of(calibration: CameraCalibration, shown: BoardViews) -> tuple[PairAccuracy, ...]:
    """Return every pair of cameras that saw a board at once."""
    found = (
        PairAccuracy.of(calibration, link, shown)
        for link in combinations(calibration.views.cameras, 2)
    )
    return tuple(pair for pair in found if pair.boards)


def epipolar_errors(rig: StereoRig, views: BoardViews) -> NDArray:
    """Return distances of the corners from the other camera's epipolar lines [px].

    Returns:
        In the left and the right image, nan where a camera did not see the corner or its lens has
        no ray for it. Shape (V, P, 2).
    """
    flat = views.pixels.reshape(-1, 4)
    both = have_rays(rig, flat)
    errors = np.full((len(flat), len(SIDES)), np.nan)
    errors[both] = rig.epipolar_errors(flat[both])
    return errors.reshape(len(views), len(views.p_GQ), len(SIDES))


def have_rays(rig: StereoRig, pixels: NDArray) -> NDArray:
    """Return which corners lie within the reach of both lenses; False for nan. (n, 4) -> (n,)."""
    return np.asarray(rig.left.has_rays(pixels[:, :2]) & rig.right.has_rays(pixels[:, 2:]))


def beyond_learned(calibration: CameraCalibration, views: BoardViews) -> NDArray:
    """Return which corners lie further out in an image than any learned from, or have no ray.

    What a lens does there no board has told.

    Args:
        views: Other views, of the same cameras.

    Returns:
        Boolean; False where not seen. Shape (V, C, P).
    """
    found = np.zeros(views.seen.shape, dtype=bool)
    learned = calibration.views.select(~calibration.outliers)
    for c, (name, camera) in enumerate(zip(views.cameras, calibration.cameras, strict=True)):
        known, pixels = from_centre(camera, learned.of_camera(name)), views.of_camera(name)
        rays = np.isfinite(camera.directions(pixels.reshape(-1, 2))).all(axis=1)
        out = from_centre(camera, pixels) > np.nanmax(known, initial=0.0)
        found[:, c] = (out | ~rays.reshape(out.shape)) & views.seen[:, c]
    return found


def from_centre(camera: Camera, pixels: NDArray) -> NDArray:
    """Return distances from the principal point [px]; nan stays nan. Shape (..., 2) -> (...)."""
    return np.asarray(np.linalg.norm(pixels - [camera.cx, camera.cy], axis=-1))


def corner_distances(residuals: NDArray) -> NDArray:
    """Return Euclidean errors of the corners that were seen, of all cameras [px]. Shape (n,)."""
    distances = np.linalg.norm(residuals.reshape(-1, 2), axis=1)
    return distances[np.isfinite(distances)]


def _edges(points: NDArray) -> tuple[NDArray, NDArray, float]:
    """Return pairs of neighbouring corners and the length of an edge."""
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    square = float(distances[distances > 0.0].min())
    first, second = np.nonzero(np.triu(np.abs(distances - square) < 1e-6 * square))
    return first, second, square
