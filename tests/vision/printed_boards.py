"""Boards photographed with a known truth: OpenCV prints them, OpenCV's lens bends them.

Nothing of the package is used. A pixel is averaged over 4 x 4 hits; an integer pixel is its centre.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

SIZE = (800, 600)
BLACK, WHITE = 40.0, 205.0
_FINE = 4
TEXELS = 24
"""Texels along a square, or a cell of ten of a tag."""


@dataclass(frozen=True)
class Lens:
    """A camera: OpenCV's coefficients, of `cv2.fisheye` where it is one."""

    focal: tuple[float, float] = (620.0, 615.0)
    centre: tuple[float, float] = (405.0, 296.0)
    bends: tuple[float, ...] = (-0.22, 0.06, 0.0, 0.0, 0.0)
    fisheye: bool = False

    @property
    def K(self):
        """The intrinsic matrix."""
        return np.array(
            [[self.focal[0], 0.0, self.centre[0]], [0.0, self.focal[1], self.centre[1]], [0, 0, 1]]
        )

    def rays(self, pixels):
        """Return directions, nan where there are none. Shape (n, 2) -> (3, n).

        By a table of how far from the centre each angle is shown: `cv2.undistortPoints` misses by
        0.1 px behind wide lenses.
        """
        x, y = ((pixels - self.centre) / self.focal).T
        size = np.hypot(x, y)
        theta = np.linspace(0.0, np.pi if self.fisheye else np.radians(80.0), 20001)
        bent = self._bent(theta) if self.fisheye else self._shown(np.tan(theta))
        last = int(np.argmax(np.diff(bent, append=-np.inf) <= 0.0))
        angle = np.interp(size, bent[: last + 1], theta[: last + 1], right=np.nan)
        across = np.sin(angle) / np.where(size > 0.0, size, 1.0)
        return np.stack([across * x, across * y, np.cos(angle)])

    def pixels(self, p):
        """Return the pixels of points before the camera; nan behind a lens that is no fisheye."""
        if not self.fisheye:
            ahead = p[:, 2] > 0.05 * np.linalg.norm(p, axis=1)
            safe = np.where(ahead[:, None], p, [0.0, 0.0, 1.0])
            found = cv2.projectPoints(safe, np.zeros(3), np.zeros(3), self.K, self.bends)[0]
            return np.where(ahead[:, None], found.reshape(-1, 2), np.nan)
        off = np.hypot(p[:, 0], p[:, 1])
        ratio = self._bent(np.arctan2(off, p[:, 2])) / np.maximum(off, 1e-12)
        return p[:, :2] * ratio[:, None] * self.focal + self.centre

    def _shown(self, radius):
        assert self.bends[2:4] == (0.0, 0.0), "tangential distortion has no radius"
        line = np.column_stack([radius, np.zeros_like(radius), np.ones_like(radius)])
        none = np.zeros(3)
        return cv2.projectPoints(line, none, none, np.eye(3), self.bends)[0].reshape(-1, 2)[:, 0]

    def _bent(self, theta):
        return theta * (1.0 + sum(k * theta ** (2 * i + 2) for i, k in enumerate(self.bends)))


PLAIN = Lens()


@dataclass(frozen=True, eq=False)
class Print:
    """A printed page: white is True; one texel is `texel` metres, `origin` its first's corner."""

    white: np.ndarray
    texel: float
    origin: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Photograph:
    """A picture, where the board's points truly are, and which are neither hidden nor outside."""

    image: np.ndarray
    pixels: np.ndarray
    free: np.ndarray


def charuco_print(columns, rows, square, marker, dictionary, *, legacy=False):
    """Print a ChArUco board by its squares each way, with OpenCV's own drawing."""
    side = 2 * TEXELS
    board = cv2.aruco.CharucoBoard((columns, rows), square, marker, dictionary)
    board.setLegacyPattern(legacy)
    image = board.generateImage((columns * side, rows * side), marginSize=0, borderBits=1)
    white = np.pad(image > 127, side // 2, constant_values=True)
    texel = square / side
    return Print(white, texel, (-1.5 * square, -1.5 * square))


def chess_print(columns, rows, square):
    """Return a chessboard of so many inner corners, its first inner square dark."""
    side = 2 * TEXELS
    light = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2
    white = np.pad(np.kron(light, np.ones((side, side))) > 0, side // 2, constant_values=True)
    return Print(white, square / side, (-1.5 * square, -1.5 * square))


CODES_36H11 = (
    *(0xD5D628584, 0xD97F18B49, 0xDD280910E, 0xE479E9C98, 0xEBCBCA822),
    *(0xF31DAB3AC, 0x056A5D085, 0x10652E1D4, 0x22B1DFEAD, 0x265AD0472),
)
"""Cells of the first tags of 36h11 row by row, 1 where white: from the AprilTag library."""


def cells_of_code(code):
    """Return a tag's inner cells as its library prints them, True where white. Shape (6, 6)."""
    return np.array([int(bit) for bit in f"{code:036b}"]).reshape(6, 6) > 0


def april_print(columns, rows, size, spacing, dictionary, border=2, turned=False):
    """Print a grid of tags as Kalibr does: ids from the lower left, borders of two cells.

    The tags stand as their library has them, whatever OpenCV does, or are turned round.
    """
    inner = cv2.aruco.generateImageMarker(dictionary, 0, 8)[1:-1, 1:-1] > 0
    turned ^= not np.array_equal(inner, cells_of_code(CODES_36H11[0]))
    cells = 6 + 2 * border
    cell = 80 // cells
    tag, gap = 80, round(80 * spacing)
    pitch = tag + gap
    white = np.ones((rows * pitch + gap, columns * pitch + gap), bool)
    for r in range(rows + 1):
        for c in range(columns + 1):
            white[r * pitch : r * pitch + gap, c * pitch : c * pitch + gap] = False
    for number in range(columns * rows):
        c, up = number % columns, number // columns
        top, left = (rows - 1 - up) * pitch + gap, c * pitch + gap
        bits = cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=border) > 0
        bits = bits[::-1, ::-1] if turned else bits
        part = np.kron(bits, np.ones((cell, cell), bool))
        white[top : top + tag, left : left + tag] = part
    white = np.pad(white, tag // 2, constant_values=True)
    texel = size / tag
    return Print(white, texel, (-(gap + tag // 2) * texel, -(gap + tag // 2) * texel))


def circle_print(points, diameter, spacing):
    """Print black discs at points [m]; texels are small against a disc, edges are smooth."""
    texel = spacing / (2 * TEXELS)
    low, high = points[:, :2].min(axis=0) - 1.5 * spacing, points[:, :2].max(axis=0) + 1.5 * spacing
    shape = np.ceil((high - low) / texel).astype(int)[::-1]
    v, u = np.indices(shape) + 0.5
    at = np.stack([u, v], axis=-1) * texel + low
    white = np.ones(shape)
    for point in points[:, :2]:
        off = np.linalg.norm(at - point, axis=2) - 0.5 * diameter
        white = np.minimum(white, np.clip(off / texel + 0.5, 0.0, 1.0))
    return Print(white, texel, tuple(low))


def photographed(
    printed,
    points,
    rng,
    *,
    hidden=0.0,
    blur=0.7,
    noise=2.0,
    tilt=0.8,
    fill=0.75,
    lens=PLAIN,
    spread=None,
    pose=None,
    fine=_FINE,
):
    """Photograph a page with a piece of card over a share of the board.

    The page hangs at random, its middle up to `spread` [rad] off the camera's axis, or in a `pose`.
    A pixel is the mean of `fine` x `fine` places.
    """
    R, t = pose or pose_of(points, rng, tilt=tilt, fill=fill, lens=lens, spread=spread)
    width, height = SIZE
    # Where each ray meets the page: t + R (x, y, 0) = s d, with s > 0.
    H = np.linalg.inv(np.column_stack([R[:, :2], t]))
    on = H.astype(np.float32) @ _rays(lens, fine)
    ahead = on[2] > 0.0
    page = on[:2] / np.where(ahead, on[2], 1.0)
    page = (page - np.reshape(printed.origin, (2, 1))) / printed.texel - 0.5
    page = np.where(ahead, page, -1e6)
    ink = BLACK + (WHITE - BLACK) * printed.white.astype(np.float32)
    maps = [m.reshape(height * fine, width * fine).astype(np.float32) for m in page]
    bright = cv2.remap(
        ink, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120
    )
    pixels = _projected(points, R, t, lens)
    card = _card(points, R, t, rng, hidden, lens)
    if card is not None:
        scaled = np.rint(((card + 0.5) * fine - 0.5) * 16).astype(np.int32)
        cv2.fillConvexPoly(bright, scaled, 150.0, shift=4)
    image = cv2.resize(bright, SIZE, interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
    light = 1.0 + 0.25 * (np.linspace(-0.5, 0.5, width) * rng.uniform(-1, 1))
    image = image * light + rng.normal(0.0, noise, image.shape)
    gray = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    free = np.all((pixels > 3.0) & (pixels < np.array(SIZE) - 4.0), axis=1)
    if card is not None:
        outline = card.astype(np.float32).reshape(-1, 1, 2)
        free &= [
            cv2.pointPolygonTest(outline, (float(u), float(v)), True) < -3.0 for u, v in pixels
        ]
    return Photograph(gray, pixels, free)


@cache
def _rays(lens, fine):
    """Return directions to the places at which a picture is hit. Shape (3, n)."""
    # Exact at the pixels' centres and just outside the picture, between them parabolas each way: of
    # the fine places there are millions. Lines would be off by a thousandth of a pixel.
    width, height = (side + 2 for side in SIZE)
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1) - 1.0
    rays = lens.rays(pixels.reshape(-1, 2)).T.reshape(height, width, 3)
    rays = _finer(_finer(rays, fine).swapaxes(0, 1), fine).swapaxes(0, 1)
    return rays.reshape(-1, 3).T.astype(np.float32)


def _finer(rows, fine):
    """Return `fine` places for each row but the first and the last, by a parabola of three."""
    before, here, after = rows[:-2], rows[1:-1], rows[2:]
    found = np.empty((fine * len(here), *rows.shape[1:]))
    for k in range(fine):
        t = (k + 0.5) / fine - 0.5
        parabola = 0.5 * t * (t - 1.0) * before + (1.0 - t * t) * here + 0.5 * t * (t + 1.0) * after
        found[k::fine] = parabola
    return found


def _projected(points, R, t, lens):
    return lens.pixels(points.astype(float) @ R.T + t)


def pose_of(points, rng, *, tilt=0.8, fill=0.75, lens=PLAIN, spread=None):
    """Return a pose in which the board fills a share of the image's height or width."""
    middle = points.mean(axis=0)
    extent = np.ptp(points, axis=0)[:2]
    axis = rng.uniform(-np.pi, np.pi)
    turn = rng.uniform(0.0, tilt) * np.array([np.cos(axis), np.sin(axis), 0.0])
    R = cv2.Rodrigues(turn)[0] @ cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-0.4, 0.4)]))[0]
    far = lens.focal[0] * max(extent[0] / SIZE[0], extent[1] / SIZE[1])
    far = far / (fill * rng.uniform(0.75, 1.0))
    aside = rng.uniform(-0.06, 0.06, 2) * far
    t = np.array([*aside, far])
    if spread is not None:
        # Evenly over the image, as far as a lens shows angles evenly.
        off, about = spread * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
        swing = cv2.Rodrigues(off * np.array([-np.sin(about), np.cos(about), 0.0]))[0]
        R, t = swing @ R, swing @ t
    return R, t - R @ middle


def _card(points, R, t, rng, hidden, lens):
    """Return the outline of a card that hides about a share of the board from one side [px]."""
    if not hidden:
        return None
    low, high = points.min(axis=0)[:2], points.max(axis=0)[:2]
    margin = 0.3 * (high - low)
    low, high = low - margin, high + margin
    side, along = rng.integers(2), 0.0
    flat = points[:, side]
    along = np.quantile(flat, hidden) + rng.uniform(-0.002, 0.002)
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    slant = rng.uniform(-0.1, 0.1) * (high - low)[1 - side]
    if side == 0:
        corners[1, 0], corners[2, 0] = along + slant, along - slant
    else:
        corners[2, 1], corners[3, 1] = along + slant, along - slant
    return _projected(np.column_stack([corners, np.zeros(4)]), R, t, lens)
