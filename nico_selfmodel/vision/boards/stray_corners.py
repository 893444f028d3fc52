"""Corners of a board that lie where the others cannot have them.

`cornerSubPix` gives up where its search leaves the window, and hands the rough corner back without
a word, 5 to 12 px off; glare, a shadow's edge or dirt lead it astray within the window. A board is
flat and a lens is round: a homography and a few coefficients of the lens leave what noise moves a
corner by. Each corner is judged by what the others say of it: with the hat matrix H of the fit, a
residual e becomes (I - H_ii)^-1 e (Cook, Weisberg 1982, section 2.2).
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.homography import homography
from nico_selfmodel.least_squares import levenberg_marquardt
from nico_selfmodel.vision.boards.board_detection import grid_points

_SIGNIFICANT = 8.0
"""Standard deviations of a corner, where there are many others; of few they are less certain."""
_FAR = 0.3
"""Off by less, a corner is none that a search missed, a shadow or glare drew [px]."""
_WITHIN = 0.3
"""Share of a square up to which a window holds nothing of the neighbouring corners. A larger one is
drawn towards them, ..."""
_DRAWN, _DRAWN_SHARE = 6.0, 0.25
"""... by up to so many pixels, or this share of a square: for boards of small squares that is the
price of the window that was asked for."""
_BENDS = ((60, 3), (12, 2), (0, 1))
"""Least corners -> how many coefficients of the lens are fitted."""
_SMALL = 1e-3
"""Share of half the board by which points are moved to see how pixels do."""
_FIRST_FIELD, _LEAST_FIELD = 0.2, 1e-4
"""Of `a` at the start, and at least."""


def stray_corners(
    grid: NDArray,
    image_size: tuple[int, int],
    window: int | None = None,
    H: NDArray | None = None,
) -> NDArray:
    """Return which corners lie far from where the others have them.

    Args:
        grid: Corners [px]. Shape (rows, columns, 2).
        image_size: Width and height of the image, about whose centre its lens bends [px].
        window: Half side of the window of `cornerSubPix` [px]; None where it was not asked.
        H: Homography from columns and rows to pixels, where it is known. Shape (3, 3).

    Returns:
        Boolean. Shape (rows, columns).

    Raises:
        ValueError: If the corners lie on one line.
    """
    rows, columns = grid.shape[:2]
    board = grid_points(columns, rows, 1.0)[:, :2]
    corners = grid.reshape(-1, 2)
    return _far_off(board, corners, image_size, _limits(grid, window), H).reshape(rows, columns)


def stray_points(board: NDArray, corners: NDArray, image_size: tuple[int, int]) -> NDArray:
    """Return which points of any flat board lie far from where the others have them.

    Args:
        board: The points on the board, in any unit. Shape (P, 2).
        corners: Where they were found [px]. Shape (P, 2).
        image_size: Width and height of the image [px].

    Returns:
        Boolean. Shape (P,).

    Raises:
        ValueError: If the corners lie on one line.
    """
    return _far_off(board, corners, image_size, np.full(len(corners), _FAR))


def _far_off(
    board: NDArray,
    corners: NDArray,
    image_size: tuple[int, int],
    limits: NDArray,
    H: NDArray | None = None,
) -> NDArray:
    """Return which of some points are off by more than their limits [px], and than chance."""
    fit = BoardBehindLens(board, corners, image_size, H)
    e, own = fit.residuals_and_leverage()
    without = np.linalg.solve(np.eye(2) - own, e[:, :, None])[:, :, 0]  # had it had no part
    squared = np.sum(e * without, axis=1)
    freedom = max(e.size - fit.count - 2, 1)
    # How far corners scatter: as all others say, or as the median one where several are off. Of two
    # coordinates the median square is 2 ln 2 variances.
    others = np.maximum(np.sum(e * e) - squared, 0.0) / freedom
    variance = np.maximum(np.minimum(others, np.median(squared) / (2.0 * np.log(2.0))), 1e-18)
    certain = _SIGNIFICANT**2 * (1.0 + 20.0 / freedom)
    far = np.linalg.norm(without, axis=1) * fit.pixels > limits
    return np.asarray(far & (squared > certain * variance))


class BoardBehindLens:
    """Corners as a plane behind a round lens, however wide its field.

    y ~ H b, r = |y|, t = atan(sqrt(a) r) / sqrt(a), z = t (1 + k1 t^2 + k2 t^4) y / r: the lens of
    Devernay and Faugeras (2001), which a fisheye is, with a polynomial for what is left.
    """

    def __init__(
        self,
        board: NDArray,
        corners: NDArray,
        image_size: tuple[int, int],
        H: NDArray | None = None,
    ) -> None:
        """Fit it by least squares.

        Args:
            board: Points on the board, in any unit. Shape (P, 2).
            corners: Where they were found [px]. Shape (P, 2).
            image_size: Width and height of the image [px].
            H: Homography from the board to pixels, where it is known. Shape (3, 3).

        Raises:
            ValueError: If the corners lie on one line.
        """
        self._centre = 0.5 * (np.array(image_size) - 1.0)
        self.pixels = float(np.hypot(*self._centre))
        """Of the unit of length: from the image's centre to its corner."""
        self._low, high = board.min(axis=0), board.max(axis=0)
        self._half = 0.5 * np.maximum(high - self._low, 1e-300)
        self._board = self._spread(board)
        self._measured = ((corners - self._centre) / self.pixels).T
        start = self._start(homography(board, corners) if H is None else H)
        bends = next(k for least, k in _BENDS if len(board) >= least)
        self.count = 8 + bends
        start = np.append(start, [_FIRST_FIELD, 0.0, 0.0][:bends])
        least = np.where(np.arange(self.count) == 8, _LEAST_FIELD, -np.inf)
        limits = {"max_iterations": 30, "tolerance": 1e-3}  # it is held against many sigmas
        self._x = levenberg_marquardt(self._normal_equations, start, least=least, **limits).x

    def _start(self, H: NDArray) -> NDArray:
        """Return a homography from the board to pixels in the units of the fit. Shape (8,)."""
        of_board = np.diag([*self._half, 1.0])
        of_board[:2, 2] = self._low + self._half
        of_pixels = np.diag([*[1.0 / self.pixels] * 2, 1.0])
        of_pixels[:2, 2] = -self._centre / self.pixels
        own = of_pixels @ H @ of_board
        return np.asarray((own / own[2, 2]).ravel()[:8])

    @classmethod
    def of_seen(
        cls, board: NDArray, corners: NDArray, image_size: tuple[int, int]
    ) -> "BoardBehindLens":
        """Fit it to those corners that are not nan; as the constructor."""
        seen = np.isfinite(corners[:, 0])
        return cls(board[seen], corners[seen], image_size)

    def pixels_of(self, board: NDArray) -> NDArray:
        """Return where other points of the board are [px]. Shape (n, 2) -> (n, 2)."""
        z, _ = self._mapped(self._x, self._spread(board))
        return np.asarray(self._centre + self.pixels * z.T)

    def steps_at(self, board: NDArray) -> NDArray:
        """Return how pixels move along x and y of the board, as columns [px per unit].

        Args:
            board: Points, in the same unit. Shape (n, 2).

        Returns:
            Shape (n, 2, 2).
        """
        ways = _SMALL * float(self._half.max()) * np.eye(2)
        moved = [self.pixels_of(board + way) - self.pixels_of(board - way) for way in ways]
        return np.stack(moved, axis=2) / (2.0 * ways.max())

    def _spread(self, board: NDArray) -> NDArray:
        """Return points with what the homography works on from -1 to 1. Shape (3, n)."""
        unit = (board - self._low) / self._half - 1.0
        return np.vstack([unit.T, np.ones(len(unit))])

    def residuals_and_leverage(self) -> tuple[NDArray, NDArray]:
        """Return residuals, shape (n, 2), and each corner's part of the hat matrix, (n, 2, 2)."""
        z, jacobian = self._mapped(self._x, self._board)
        q, _ = np.linalg.qr(jacobian.transpose(2, 1, 0).reshape(-1, self.count))
        q = q.reshape(-1, 2, self.count)
        # A corner that decides a parameter alone has no residual to be judged by.
        return (z - self._measured).T, (1.0 - 1e-9) * (q @ np.swapaxes(q, 1, 2))

    def _normal_equations(self, x: NDArray) -> tuple[float, NDArray, NDArray]:
        z, jacobian = self._mapped(x, self._board)
        r, flat = (z - self._measured).ravel(), jacobian.reshape(self.count, -1)
        return 0.5 * float(r @ r), flat @ r, flat @ flat.T

    def _mapped(self, x: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
        """Return where points of the board are, (2, n), and derivatives by x, (count, 2, n)."""
        H = np.append(x[:8], 1.0).reshape(3, 3)
        a, k1, k2 = np.append(x[8:], np.zeros(11 - len(x)))
        root, jacobian = np.sqrt(a), np.empty((self.count, 2, b.shape[1]))
        with np.errstate(all="ignore"):  # where a step went too far the cost says so
            v = H @ b
            y, ratio = v[:2] / v[2], b / v[2]
            r2 = np.maximum(y[0] * y[0] + y[1] * y[1], 1e-18)
            r = np.sqrt(r2)
            t = np.arctan(root * r) / root
            t2 = t * t
            stretch = t * (1.0 + t2 * (k1 + t2 * k2)) / r
            by_t, t_by_r = 1.0 + t2 * (3.0 * k1 + t2 * 5.0 * k2), 1.0 / (1.0 + a * r2)
            # d(z y/r)/dy = z/r I + (z' - z/r) y y' / r^2;  dy/dH_0j = b_j / v_2, ...
            along, towards = by_t * t_by_r, y / r
            by_y = y[:, None] * ((along - stretch) / r2 * y)
            by_y[0, 0] += stretch
            by_y[1, 1] += stretch
            np.multiply(by_y[:, None], ratio[:, None], out=jacobian[:6].reshape(2, 3, *y.shape))
            np.multiply(-along * y, ratio[:2, None], out=jacobian[6:8])
            jacobian[8] = by_t * (r * t_by_r - t) / (2.0 * a) * towards
            for power, by_k in zip((t * t2, t * t2 * t2), jacobian[9:], strict=False):
                np.multiply(power, towards, out=by_k)
            return stretch * y, jacobian


def _limits(grid: NDArray, window: int | None) -> NDArray:
    """Return how far a corner may be off [px]. Shape (rows * columns,)."""
    if window is None:
        return np.full(grid.shape[0] * grid.shape[1], _FAR)
    square = _smallest_step(grid).ravel()
    drawn = np.minimum(_DRAWN, _DRAWN_SHARE * square)
    return np.where(window <= _WITHIN * square, _FAR, np.maximum(drawn, _FAR))


def _smallest_step(grid: NDArray) -> NDArray:
    """Return each corner's distance from its nearest neighbour [px]. Shape (rows, columns)."""
    steps = np.full(grid.shape[:2], np.inf)
    for along, of in ((grid, steps), (grid.swapaxes(0, 1), steps.T)):
        lengths = np.linalg.norm(np.diff(along, axis=0), axis=2)
        np.minimum(of[:-1], lengths, out=of[:-1])
        np.minimum(of[1:], lengths, out=of[1:])
    return steps
