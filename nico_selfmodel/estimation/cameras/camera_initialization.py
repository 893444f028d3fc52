"""Closed-form starts of a camera calibration: Zhang's method, lenses, the pair's relative pose."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError, NotIdentifiableError
from nico_selfmodel.geometry.epipolar import RelativePose
from nico_selfmodel.geometry.homography import homography
from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, RATIONAL, project_in_camera
from nico_selfmodel.names import listed

_PARALLEL = np.radians(3.0)
"""Boards whose normals differ by less than this leave the focal length open."""
_FISHEYE_VIEWS = np.array([90.0, 110.0, 130.0, 150.0, 170.0, 190.0, 220.0])
"""Angles of view along the longer side that a fisheye may have [deg]."""
_AHEAD = 0.05
"""Cosine of the angle from a board's middle up to which its corners place it."""
_STEEPEST = np.radians(85.0)
"""Angle off the axis up to which a rational lens is made like a fisheye."""
_PLACES, _PASSES, _HELD = 100, 4, 1e-5
"""Angles at which it is, how often, and the weight that keeps coefficients small."""
_AGREEING = 0.1
"""Boards whose views of the cameras' relative pose differ by less, in radians and depths, agree."""


def zhang_start(views: BoardViews) -> tuple[Camera, NDArray]:
    """Estimate one camera's focal lengths and boards from homographies (Zhang 2000).

    With the principal point held at the image's centre, each board gives two equations in
    1 / fx^2 and 1 / fy^2: h1' w h2 = 0 and h1' w h1 = h2' w h2, w = diag(1/fx^2, 1/fy^2, 1).

    Args:
        views: What one camera saw; corners not seen are left out of each board.

    Returns:
        A camera without distortion at the world's origin, and X_CG of every board, shape (V, 4, 4).

    Raises:
        NotIdentifiableError: If the boards stand so that they leave the focal length open.
    """
    ((width, height),) = views.image_sizes
    center = np.array([0.5 * (width - 1), 0.5 * (height - 1)])
    plane = views.p_GQ[:, :2]
    maps = _homographies(plane, views.pixels - center)
    h1, h2 = maps[:, :, 0], maps[:, :, 1]
    # Pixels are large numbers: without a common scale the last column would rule.
    size = 1.0 / np.linalg.norm(maps[:, :, :2], axis=(1, 2))
    rows = np.concatenate([h1 * h2, h1**2 - h2**2]) * np.tile(size**2, 2)[:, None]
    inverse_squares = np.linalg.lstsq(rows[:, :2], -rows[:, 2], rcond=None)[0]
    if not (inverse_squares > 0.0).all():
        # Noise has the last word on boards that nearly face the camera: one focal length then.
        both = rows[:, :2].sum(axis=1)
        inverse_squares = np.full(2, -(both @ rows[:, 2]) / (both @ both))
    if not (inverse_squares > 0.0).all():
        inverse_squares = np.full(2, max(width, height) ** -2.0)
    fx, fy = inverse_squares**-0.5
    camera = Camera(fx, fy, center[0], center[1], (width, height))
    return camera, board_poses(maps, fx, fy)


def fisheye_start(views: BoardViews) -> tuple[Camera, NDArray]:
    """Estimate a fisheye's focal length and boards: the one of a few under which boards are flat.

    Corners that are straightened with the right focal length lie in a plane's homography.

    Returns:
        A fisheye without further bends at the world's origin, and X_CG of every board, (V, 4, 4).

    Raises:
        EstimationError: If a board has too few corners within the reach of any.
    """
    ((width, height),) = views.image_sizes
    found = []
    for f in max(width, height) / np.radians(_FISHEYE_VIEWS):
        camera = Camera(f, f, 0.5 * (width - 1), 0.5 * (height - 1), (width, height), lens=FISHEYE)
        try:
            X_CG = pose_of_seen_boards((camera,), views)
        except EstimationError:
            continue
        p = np.moveaxis(apply(X_CG[:, None], views.p_GQ[None]), -1, 0)
        shown = np.moveaxis(project_in_camera(p, camera.values, FISHEYE)[0], 0, -1)
        missed = np.linalg.norm(shown - views.pixels, axis=2)
        found.append((float(np.nanmedian(missed)), camera, X_CG))
    if not found:
        raise EstimationError("no fisheye sees these boards: are they in view, near its centre?")
    return min(found, key=lambda one: one[0])[1:]


def rational_like(fisheye: Camera, pixels: NDArray) -> Camera:
    """Return the rational lens that bends light as a fisheye does, as far out as corners were seen.

    Of as many coefficients as leave no pole there.

    Args:
        pixels: Corners, nan where not seen. Shape (..., 2).

    Returns:
        A camera with the same focal lengths and centre; without bends if no fraction will do.
    """
    axis = fisheye.directions(pixels[np.isfinite(pixels[..., 0])])[:, 2]
    widest = float(np.arccos(np.nanmin(axis, initial=1.0)))
    theta = np.linspace(0.0, min(widest, _STEEPEST), _PLACES + 1)[1:]
    r = np.tan(theta)
    s = fisheye.profile(theta)[0] / r
    found = (_fraction(r, s, degree) for degree in (3, 2, 1))
    k = next((fraction for fraction in found if fraction is not None), np.zeros(6))
    return replace(fisheye, lens=RATIONAL, **{f"k{i + 1}": float(x) for i, x in enumerate(k)})


def _fraction(r: NDArray, s: NDArray, degree: int) -> NDArray | None:
    """Return k1 to k6 of the fraction N(r^2) / D(r^2) that is s, none beyond a degree in r^2.

    N(r^2) = s D(r^2) is linear in them. Divided by the D of the pass before it is what a pixel is
    off by, over fx r (Sanathanan, Koerner 1963). None with a pole among the r.
    """
    power = 2.0 * np.arange(1, degree + 1)
    powers = (r / r[-1])[:, None] ** power
    k, below = np.zeros((2, degree)), np.ones_like(r)
    for _ in range(_PASSES):
        weight = r / below
        rows = weight[:, None] * np.hstack([powers, -s[:, None] * powers])
        held = np.diag(_HELD * np.linalg.norm(rows, axis=0))
        right = np.append(weight * (s - 1.0), np.zeros(2 * degree))
        k = np.linalg.lstsq(np.vstack([rows, held]), right)[0].reshape(2, degree)
        below = 1.0 + powers @ k[1]
        if below.min() <= 0.0:
            return None
    return np.pad(k / r[-1] ** power, ((0, 0), (0, 3 - degree))).ravel()


def board_poses(maps: NDArray, fx: float, fy: float) -> NDArray:
    """Return the boards' poses from their homographies into centred pixels.

    Args:
        maps: From board coordinates [m] to centred pixels. Shape (V, 3, 3).
        fx: Focal length [px].
        fy: Focal length [px].

    Returns:
        X_CG with the boards in front of the camera. Shape (V, 4, 4).
    """
    columns = maps / np.array([[fx], [fy], [1.0]])
    length = np.linalg.norm(columns[:, :, :2], axis=1).prod(axis=1)
    columns = columns * (np.sign(columns[:, 2, 2]) / np.sqrt(length))[:, None, None]
    r1, r2, t = np.moveaxis(columns, 2, 0)
    return transform(nearest_rotation(np.stack([r1, r2, np.cross(r1, r2)], axis=2)), t)


def check_tilts(X_CG: NDArray, camera: str) -> None:
    """Refuse boards that are all parallel: their focal length trades against their distance.

    Raises:
        NotIdentifiableError: Naming the focal length.
    """
    normals = X_CG[:, :3, 2]
    # A board listed from another corner may turn its normal round.
    cosine = np.minimum(np.abs(normals @ normals.T), 1.0)
    spread = float(np.arccos(cosine.min()))
    if spread < _PARALLEL:
        raise NotIdentifiableError(
            f"all boards are parallel within {np.degrees(spread):.1f} deg: `{camera}.fx` and "
            f"`{camera}.fy` cannot be told from the boards' distance; tilt the board by 20 deg and "
            "more in different directions"
        )


def pair_start(
    left: tuple[Camera, NDArray], right: tuple[Camera, NDArray], views: BoardViews
) -> NDArray:
    """Place one camera before another by the essential matrix.

    Args:
        left: A camera and X_LG of all views; nan where it saw nothing.
        right: The other and X_RG of all views; nan where it saw nothing.

    Returns:
        X_LR, the other camera in the frame of the first. Shape (4, 4).

    Raises:
        EstimationError: If the two cameras share no board, or the corners allow no relative pose.
    """
    both = np.asarray(views.seen.all(axis=1))
    if not both.any():
        raise EstimationError("no view shows the board to both cameras: they need boards in common")
    shared = both.any(axis=1)
    agreeing = np.zeros(len(views), dtype=bool)
    agreeing[shared] = _agreeing(left[1][shared], right[1][shared])
    both &= agreeing[:, None]
    pixels = [views.of_camera(camera)[both] for camera in views.cameras]
    # A rough lens may not reach as far as the image: the rest is enough for a start.
    usable = left[0].has_rays(pixels[0]) & right[0].has_rays(pixels[1])
    try:
        pose = RelativePose.from_points(
            left[0].undistort(pixels[0][usable]), right[0].undistort(pixels[1][usable])
        )
    except ValueError as error:
        raise EstimationError(
            f"no relative pose of the cameras: {error} Or are both images from the same camera, or "
            "was a camera told what it is not?"
        ) from error
    # The boards' size gives the baseline its length: R t_L + s d = t_R.
    gap = right[1][agreeing, :3, 3] - left[1][agreeing, :3, 3] @ pose.rotation.T
    length = float(np.median(gap @ pose.translation))
    return np.linalg.inv(transform(pose.rotation, length * pose.translation))


def _agreeing(X_LG: NDArray, X_RG: NDArray) -> NDArray:
    """Return which boards place the right camera where most of them do. Boolean, shape (V,).

    Each board gives X_LR = X_LG X_RG^-1; the one in the middle of them is taken for the truth.
    """
    X_LR = X_LG @ inverse(X_RG)
    depth = np.median(X_LG[:, 2, 3])
    distance = poses_apart(X_LR, X_LR, float(depth))
    middle = int(np.argmin(np.median(distance, axis=1)))
    return distance[middle] <= max(_AGREEING, 3.0 * float(np.median(distance[middle])))


def poses_apart(X: NDArray, Y: NDArray, depth: float) -> NDArray:
    """Return how far poses are apart, in radians and depths.

    Args:
        X: Shape (m, 4, 4).
        Y: Shape (k, 4, 4).
        depth: What a shift is measured by.

    Returns:
        Shape (m, k).
    """
    turn = np.linalg.norm(X[:, None, :3, :3] - Y[:, :3, :3], axis=(2, 3)) / np.sqrt(2.0)
    shift = np.linalg.norm(X[:, None, :3, 3] - Y[:, :3, 3], axis=2) / depth
    return np.asarray(turn + shift)


def _homographies(plane: NDArray, pixels: NDArray) -> NDArray:
    """Return the homography of each view, from the corners that were seen. Shape (V, 3, 3)."""
    seen = np.asarray(np.isfinite(pixels).all(axis=2))
    if seen.all():
        return homography(plane[None], pixels)
    return np.array([homography(plane[s], p[s]) for s, p in zip(seen, pixels, strict=True)])


def pose_of_seen_boards(cameras: tuple[Camera, ...], views: BoardViews) -> NDArray:
    """Place boards before calibrated cameras, each by the first camera that saw it.

    Corners beyond the fold of a lens have no ray and do not count.

    Args:
        cameras: The cameras, the first one at the world.

    Returns:
        X_LG. Shape (V, 4, 4).

    Raises:
        EstimationError: If no camera saw a board, or not within the reach of its lens.
    """
    X_LG = np.full((len(views), 4, 4), np.nan)
    d, placing = _rays(cameras, views)
    for c, camera in reversed(list(enumerate(cameras))):
        rows = np.flatnonzero(placing[:, c])
        X_LG[rows] = camera.X_WC @ flat_boards(views.p_GQ[:, :2], d[c, rows])
    unseen = [views.names[v] for v in np.flatnonzero(~placing.any(axis=1))]
    if unseen:
        raise EstimationError(
            f"no camera saw board {listed(unseen)}, or only beyond the fold of its lens"
        )
    return X_LG


def within_reach(cameras: tuple[Camera, ...], views: BoardViews) -> NDArray:
    """Tell which boards some camera saw within the reach of its lens. Boolean, shape (V,)."""
    return np.asarray(_rays(cameras, views)[1].any(axis=1))


def _rays(cameras: tuple[Camera, ...], views: BoardViews) -> tuple[NDArray, NDArray]:
    """Return directions of corners, (C, V, P, 3), and which cameras' place a board. (V, C)."""
    sides = zip(cameras, views.cameras, strict=True)
    d = np.stack(
        [camera.directions(views.of_camera(side).reshape(-1, 2)) for camera, side in sides]
    )
    d = d.reshape(len(cameras), *views.pixels.shape[:2], 3)
    seen = np.repeat(np.isfinite(d[..., 0]).transpose(1, 2, 0), 2, axis=2)
    return d, replace(views, pixels=np.where(seen, views.pixels, np.nan)).placing


def flat_boards(plane: NDArray, directions: NDArray) -> NDArray:
    """Place flat boards before a camera, wherever it looks.

    Args:
        plane: Corners in the board's plane [m]. Shape (C, 2).
        directions: Unit directions in which each is seen, nan where it is not. Shape (V, C, 3).

    Returns:
        X_CG. Shape (V, 4, 4).

    Raises:
        ValueError: If of a board too few corners, or such on one line, are seen.
    """
    # Seen along its middle, a board beside or behind the camera is as good as any before it.
    turn = _towards(np.nanmean(directions, axis=1))
    seen = directions @ np.swapaxes(turn, 1, 2)
    ahead = seen[:, :, 2:] > _AHEAD
    ideal = np.where(ahead, seen[:, :, :2] / np.where(ahead, seen[:, :, 2:], 1.0), np.nan)
    back = transform(np.swapaxes(turn, 1, 2), np.zeros((len(turn), 3)))
    return np.asarray(back @ board_poses(_homographies(plane, ideal), 1.0, 1.0))


def _towards(directions: NDArray) -> NDArray:
    """Return rotations that take directions to z. Shape (n, 3) -> (n, 3, 3)."""
    z = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    upright = np.abs(z[:, 1]) < 0.9
    x = np.cross(np.where(upright[:, None], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=1)
