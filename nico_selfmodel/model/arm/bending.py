"""What bends in an arm: sag of joints and bearings, backlash, ripple of gears, coupling of drives.

With the unit vector `up` in W, z_i the axes, R_j the frames after each row and l_j the first moment
of link j and of all that it carries (weights add up to one):

    F_i    = sum over j >= i of R_j l_j          first moment of all beyond joint i
    mu_i   = F_i x (-up)                         its moment
    theta_i += sag_i (z_i . mu_i) + sum over h of a_ih sin(h q_i) + b_ih cos(h q_i) + (C q)_i
    theta_i -= backlash_i s_i, s_i = -1 or 1 as the encoder last moved, 0 where nobody knows
    bearing i turns by bearing_sag_i (x_i . mu_i, y_i . mu_i) about its own place on the axis

Gravity pulls along mu: a joint that gives way has a positive sag, whatever its sense of turning.
Moments are those of the arm before it bends, for bends are milliradians. No masses are needed:
only products of stiffness and load are seen. The loads of uniform rods along the learned arm are
where the estimate begins, known to a part of themselves (`estimation/bending`, docs/bending.md).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.names import refuse_unknown

SAG, BEARING, BACKLASH = "sag", "bearing_sag", "backlash"
RIPPLE, COUPLING = "ripple", "coupling"
LOADS, PIVOTS = "loads", "pivots"
EFFECTS = (SAG, BEARING, BACKLASH, RIPPLE, COUPLING)
"""What may bend, in the order in which it is asked for."""
PARTS = (*EFFECTS, LOADS, PIVOTS)
"""What is learned of it: of what sags how it is loaded besides, and where its bearings are."""
HARMONICS = (1, 2)
"""Of the ripple, in turns of the joint."""
_X, _Y, _Z = np.eye(3)


@dataclass(frozen=True, eq=False)
class Bending:
    """What bends in an arm, joint by joint; what was not learned is zero."""

    joints: tuple[str, ...]
    """Names, from the base outwards. Length n."""
    effects: tuple[str, ...]
    """Those that were learned, of `PARTS`."""
    up: NDArray
    """Unit vertical in W. Shape (3,)."""
    loads: NDArray
    """First moments l_j in the frame after each row [m of the arm's weight]. Shape (n, 3)."""
    pivots: NDArray
    """Place of each bearing along the joint's axis, from the frame before its row [m]. (n,)."""
    sag: NDArray
    """[rad/m]. Shape (n,)."""
    bearing_sag: NDArray
    """[rad/m]. Shape (n,)."""
    backlash: NDArray
    """Half width of the play that a joint is behind its drive by [rad]. Shape (n,)."""
    ripple: NDArray
    """Of sine and cosine of each harmonic [rad]. Shape (n, 2, 2)."""
    coupling: NDArray
    """Turn of a joint (row) by the displacement of another (column). Shape (n, n)."""

    def __post_init__(self) -> None:
        """Check shapes and make the arrays read-only."""
        n = len(self.joints)
        shapes = {
            "up": (3,),
            "loads": (n, 3),
            "pivots": (n,),
            SAG: (n,),
            BEARING: (n,),
            BACKLASH: (n,),
            RIPPLE: (n, len(HARMONICS), 2),
            COUPLING: (n, n),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))
        for effect in self.effects:
            refuse_unknown("effect", effect, PARTS)
        length = float(np.linalg.norm(self.up))
        if abs(length - 1.0) > 1e-9:
            raise ValueError(f"up must be a direction of length 1, got length {length:g}")
        if np.any(np.diag(self.coupling) != 0.0):
            raise ValueError("a joint is coupled to others: its own part belongs to its gear")

    @classmethod
    def none(
        cls, joints: tuple[str, ...], up: NDArray, loads: NDArray, pivots: NDArray
    ) -> "Bending":
        """Return an arm of these loads that does not bend."""
        n = len(joints)
        zero = np.zeros(n)
        ripple = np.zeros((n, len(HARMONICS), 2))
        return cls(joints, (), up, loads, pivots, zero, zero, zero, ripple, np.zeros((n, n)))

    def with_effects(self, *effects: str) -> "Bending":
        """Return the same with other effects learned; the others become zero.

        Raises:
            ValueError: If one has no such name.
        """
        for effect in effects:
            refuse_unknown("effect", effect, PARTS)
        zero = {name: np.zeros_like(getattr(self, name)) for name in EFFECTS}
        kept = {name: value for name, value in zero.items() if name not in effects}
        return replace(self, effects=tuple(e for e in PARTS if e in effects), **kept)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of what was learned, effect by effect."""
        return tuple(name for effect in self.effects for name in self.names_of(effect))

    def names_of(self, effect: str) -> tuple[str, ...]:
        """Return the names of an effect's numbers, in the order of its array."""
        joints = self.joints
        if effect == RIPPLE:
            waves = [f"{RIPPLE}{h}_{wave}" for h in HARMONICS for wave in ("sin", "cos")]
            return tuple(f"{joint}.{wave}" for joint in joints for wave in waves)
        if effect == COUPLING:
            return tuple(f"{i}.{COUPLING}_{j}" for i in joints for j in joints if i != j)
        if effect == LOADS:
            return tuple(f"{joint}.load_{axis}" for joint in joints for axis in "xyz")
        if effect == PIVOTS:
            return tuple(f"{joint}.pivot" for joint in joints)
        return tuple(f"{joint}.{effect}" for joint in joints)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of `names`."""
        by_effect = {SAG: "rad/m", BEARING: "rad/m", BACKLASH: "rad", RIPPLE: "rad"}
        by_effect |= {COUPLING: "1", LOADS: "m", PIVOTS: "m"}
        return tuple(by_effect[e] for e in self.effects for _ in self.names_of(e))

    @property
    def values(self) -> NDArray:
        """Values of `names`."""
        return np.concatenate([np.zeros(0), *(self._of(effect) for effect in self.effects)])

    def _of(self, effect: str) -> NDArray:
        found: NDArray = getattr(self, effect)
        return found[self.others] if effect == COUPLING else found.ravel()

    @property
    def others(self) -> NDArray:
        """Where `coupling` has numbers: off its diagonal. Boolean, shape (n, n)."""
        return ~np.eye(len(self.joints), dtype=bool)

    def with_values(self, values: NDArray) -> "Bending":
        """Return the same with other values, in the order of `names`."""
        changed, first = {}, 0
        for effect in self.effects:
            old = getattr(self, effect)
            count = len(self.names_of(effect))
            own = np.asarray(values[first : first + count], dtype=float)
            first += count
            if effect == COUPLING:
                new = np.zeros_like(old)
                new[self.others] = own
            else:
                new = own.reshape(old.shape)
            changed[effect] = new
        return replace(self, **changed)

    def moments(self, before: NDArray, after: NDArray, carries: NDArray | None = None) -> NDArray:
        """Return mu_i in the frame before each row.

        Args:
            before: Orientations of the frames before each joint turns. Shape (n, N, 3, 3).
            after: The same after it turned, of the body before it bends. Shape (n, N, 3, 3).
            carries: Whether a joint (row) carries a link (column); each all that follow, if
                omitted. Shape (n, n).

        Returns:
            Its components along x, y and z of the frame. Shape (n, N, 3).
        """
        carried = (after @ self.loads[:, None, :, None])[..., 0]
        if carries is None:
            F = np.cumsum(carried[::-1], axis=0)[::-1]
        else:
            F = np.tensordot(carries.astype(float), carried, 1)
        mu = np.moveaxis(cross(np.moveaxis(F, -1, 0), -self.up.reshape(3, 1, 1)), 0, -1)
        return np.asarray((np.swapaxes(before, -1, -2) @ mu[..., None])[..., 0])

    def turns(self, q: NDArray, moments: NDArray, approach: NDArray | None = None) -> NDArray:
        """Return how much each joint turns beyond its displacement.

        Args:
            q: Displacements, as their encoders tell. Shape (N, n).
            moments: `moments` there. Shape (n, N, 3).
            approach: How each encoder last moved, -1 or 1; 0 where it is not known, as all are if
                omitted: the joint is then in the middle of its backlash. Shape (N, n).

        Returns:
            Shape (N, n).
        """
        found = self.sag * moments[:, :, 2].T
        if RIPPLE in self.effects:
            for h, (sine, cosine) in zip(HARMONICS, np.moveaxis(self.ripple, 0, -1), strict=True):
                found = found + sine * np.sin(h * q) + cosine * np.cos(h * q)
        if approach is not None and BACKLASH in self.effects:
            found = found - self.backlash * approach
        return found + q @ self.coupling.T if COUPLING in self.effects else found

    def bearings(self, moments: NDArray) -> NDArray | None:
        """Return how bearings turn their rows, in the frame before each; None where none does.

        Args:
            moments: `moments` of the poses. Shape (n, N, 3).

        Returns:
            Turns about x, then about y, through each pivot. Shape (n, N, 4, 4).
        """
        if BEARING not in self.effects:
            return None
        turn = self.bearing_sag[:, None, None] * moments[..., :2]
        R = rotation_about(_X, turn[..., 0]) @ rotation_about(_Y, turn[..., 1])
        place = self.pivots[:, None, None] * _Z
        return np.asarray(transform(R, place - (R @ place[..., None])[..., 0]))
