"""The Denavit-Hartenberg view of a chain, in the thesis' convention."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_conversion import dh_rows_of_lines, parallel_rows

_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True, eq=False)
class DhTable:
    """Rows of a serial chain, `M_i = Tz(D_i) Rz(theta_i) Tx(r_i) Rx(alpha_i) Ry(beta_i)`.

    theta_i = theta_zero_i + q_i, and a tracked point is `X_W0 M_1 ... M_n p_NH` (the thesis'
    eq. 6.2-6.7; X_W0 is its M_0). beta is zero except in rows between axes within 5 deg of
    parallel, where the common normal is useless and Hayati's row takes its place.

    The tables made here fix what no measurement of points can tell: D_1 = theta_zero_1 = alpha_n
    = 0, and the first tracked point is the origin of the last frame.
    """

    joints: tuple[str, ...]
    """Names from the base outwards. Length n."""
    X_W0: NDArray
    """Pose of frame 0, whose z is the first axis, in the measuring frame. Shape (4, 4)."""
    D: NDArray
    """Offsets along the axis of the row's joint [m]. Shape (n,)."""
    theta_zero: NDArray
    """theta at q = 0 [rad]. Shape (n,)."""
    r: NDArray
    """Signed lengths of the common normals [m]. Shape (n,)."""
    alpha: NDArray
    """Twists about the common normals [rad]. Shape (n,)."""
    beta: NDArray
    """Hayati's second twist, about y [rad]; 0 for an ordinary row. Shape (n,)."""
    markers: tuple[str, ...]
    """Names of the tracked points. Length m."""
    p_NH: NDArray
    """Tracked points in the last frame [m]. Shape (m, 3)."""

    def __post_init__(self) -> None:
        """Check shapes and make the arrays read-only."""
        n = len(self.joints)
        if n == 0 or len(set(self.joints)) != n:
            raise ValueError(f"a table needs one or more joints of different names, {self.joints}")
        object.__setattr__(self, "X_W0", frozen_array(self.X_W0, (4, 4), "X_W0"))
        object.__setattr__(self, "p_NH", frozen_array(self.p_NH, (len(self.markers), 3), "p_NH"))
        for name in ("D", "theta_zero", "r", "alpha", "beta"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name))

    @classmethod
    def from_chain(cls, chain: Chain, like: "DhTable | None" = None) -> "DhTable":
        """Convert lines to rows; exact to rounding.

        x_i = +z_{i-1} x z_i, so that alpha lies in (0, pi) and r is signed: for axes that
        intersect, "r >= 0" would be decided by noise. For parallel axes r > 0.

        Args:
            like: A table whose signs and gauge are followed, so that two versions of one arm can
                be compared number by number. Which rows are Hayati's is told by these lines alone:
                a row made like one of other axes would put its feet tens of metres away.
        """
        parallel = parallel_rows(chain.directions)
        flip = np.zeros(len(parallel), dtype=bool)
        if like is not None:
            # Another kind of row has another sense of turned round.
            flip = like.flipped & (like.parallel == parallel)
        rows = dh_rows_of_lines(
            chain.directions,
            chain.points,
            chain.p_WH_zero[0],
            parallel=parallel,
            flip=flip,
            first=(like.D[0], like.theta_zero[0]) if like else (0.0, 0.0),
        )
        frames = cls(
            chain.joints, rows.X_W0, rows.D, rows.theta, rows.r, rows.alpha, rows.beta, (), _EMPTY
        )
        x_wn = frames.frames(np.zeros(len(chain.joints)))[-1]
        p_nh = (chain.p_WH_zero - x_wn[:3, 3]) @ x_wn[:3, :3]
        p_nh[0] = 0.0
        return cls(
            chain.joints,
            rows.X_W0,
            rows.D,
            rows.theta,
            rows.r,
            rows.alpha,
            rows.beta,
            chain.markers,
            p_nh,
        )

    @property
    def parallel(self) -> NDArray:
        """Which rows are Hayati's: those whose two axes are nearly parallel. Shape (n,)."""
        near = np.abs(np.cos(self.alpha) * np.cos(self.beta)) > np.cos(np.radians(5.0))
        near[-1] = False
        return near

    @property
    def flipped(self) -> NDArray:
        """Which rows have x_i against the default choice. Shape (n,)."""
        radial = self.parallel
        radial[-1] = True
        return np.where(radial, self.r < -1e-12, np.sin(self.alpha) < 0.0)

    @property
    def fixed_D(self) -> NDArray:
        """Which D no measurement can tell from other entries. Shape (n,).

        D_1 against X_W0; in a parallel row D against the next; after leading parallel rows one
        more.
        """
        parallel = self.parallel
        fixed = parallel.copy()
        fixed[: int(np.argmin(parallel)) + 1] = True
        return fixed

    def frames(self, q: ArrayLike, bearings: NDArray | None = None) -> NDArray:
        """Return frame 0 and the frame after each row, in W.

        Args:
            q: Joint displacements [rad], floats or Drake's scalars. Shape (n,) or (N, n).
            bearings: What moves each row in the frame before it, `Bending.bearings`; each frame
                is then returned where it has moved the next row to. Shape (n, N, 4, 4).

        Returns:
            Shape (n + 1, 4, 4) or (n + 1, N, 4, 4).
        """
        theta = np.asarray(q) + self.theta_zero
        lead, links = theta.shape[:-1], self.links
        cosine, sine = np.cos(theta), np.sin(theta)
        # Poses last: each step works on long rows, and so does who takes axes out of the frames.
        kind = np.result_type(cosine, float)
        out = np.empty((len(self.joints) + 1, 4, 4, *lead), kind)
        frames = np.moveaxis(out, (1, 2), (-2, -1))
        frames[0] = self.X_W0
        moved = np.empty((4, 4, *lead), kind)
        for i in range(len(self.joints)):
            if bearings is not None:
                frames[i] = frames[i] @ bearings[i]
            x, y, z, origin = out[i].swapaxes(0, 1)
            c, s = cosine[..., i], sine[..., i]
            moved[:, 0], moved[:, 1] = c * x + s * y, c * y - s * x
            moved[:, 2], moved[:, 3] = z, origin + self.D[i] * z
            flat = links[i].T @ moved.reshape(4, 4, -1)
            out[i + 1] = flat.reshape(moved.shape)
        return frames

    def joint_motions(self, theta: ArrayLike) -> NDArray:
        """Return Tz(D_i) Rz(theta_i), what moves of each row. Shape (..., n) -> (..., n, 4, 4)."""
        return transform(rotation_about(_Z, theta), self.D[:, None] * _Z)

    @property
    def links(self) -> NDArray:
        """Tx(r_i) Rx(alpha_i) Ry(beta_i), the rigid part of each row. Shape (n, 4, 4)."""
        rotation = rotation_about(_X, self.alpha) @ rotation_about(_Y, self.beta)
        return transform(rotation, self.r[:, None] * _X)

    def forward(self, q: ArrayLike, marker: int = 0) -> NDArray:
        """Predict a tracked point, p_WH [m]. Shape (N, n) -> (N, 3), or (n,) -> (3,)."""
        last = self.frames(q)[-1]
        return last[..., :3, :3] @ self.p_NH[marker] + last[..., :3, 3]

    def to_chain(self) -> Chain:
        """Convert rows to lines; exact to rounding."""
        frames = self.frames(np.zeros(len(self.joints)))
        last = frames[-1]
        return Chain(
            self.joints,
            frames[:-1, :3, 2] / np.linalg.norm(frames[:-1, :3, 2], axis=1, keepdims=True),
            frames[:-1, :3, 3],
            self.markers,
            self.p_NH @ last[:3, :3].T + last[:3, 3],
        )


_EMPTY = np.zeros((0, 3))
