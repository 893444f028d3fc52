"""How well a solution is known: covariance, correlations, rank, unobservable directions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

UNOBSERVABLE_SIGMA = 0.3
"""A direction is called unobservable where by it the standard deviation of some parameter exceeds
this fraction of its scale (1 rad, the size of the body, the gear itself): the estimate says nothing
then. A hundred markers that shift together by a hundredth each do not."""
UNKNOWN_SIGMA = 30.0
"""Most that a covariance lets a parameter be off along one direction, in natural units: where
nothing determines it, too. Finite, so that covariances can be added and inverted, but far beyond
what is known."""
_TOLD = 1e-11
"""Information on scaled parameters, of the largest, that counts as that of what is not told."""
_WELL_TOLD = 1e-8
"""Part of a parameter's own information, beside all others, above which all are told for sure."""
_DRAWN = 3.0
"""Times chance that how residuals scatter must differ from what is expected to count for itself:
noise that is as expected exceeds it once in some hundred."""
_NO_PART = 1e-6
"""Share in what nothing determines below which it is rounding."""


_PRIORS = 5.0
"""Natural scale of a parameter that is held near a value, in standard deviations of its prior."""


def scales_by_priors(
    names: Sequence[str], natural: NDArray, priors: Mapping[str, tuple[float, float]]
) -> NDArray:
    """Return natural scales on which nothing is unobservable that its prior holds near a value.

    Args:
        names: Parameters. Length k.
        natural: Their natural scales. Shape (k,).
        priors: Mean and standard deviation of those that are held, by name.

    Returns:
        Shape (k,).
    """
    held = [_PRIORS * priors[name][1] if name in priors else 0.0 for name in names]
    return np.maximum(natural, held)


@dataclass(frozen=True, eq=False)
class UnobservableDirection:
    """A combination of parameters that the data do not determine."""

    names: tuple[str, ...]
    """Parameters that take part, the strongest first."""
    shares: NDArray
    """Their signed shares, in natural units, of unit length. Shape (len(names),)."""
    sigma: float
    """Standard deviation along it, in natural units; inf where nothing determines it."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of the free parameters and what it says."""

    names: tuple[str, ...]
    """Free parameters. Length k."""
    covariance: NDArray
    """Along what nothing determines it has `UNKNOWN_SIGMA`: whoever adds, inverts or predicts by it
    takes nothing for known that is not. Shape (k, k)."""
    sigma: NDArray
    """Standard deviations of the parameters; inf for those named in an unobservable direction, or
    that take any part in one that nothing determines. Shape (k,)."""
    variance_factor: float
    """s^2, the sum of squared whitened residuals over the redundancy; nan without redundancy."""
    rank: int
    """Number of directions that are observable."""
    condition: float
    """Ratio of the largest to the smallest singular value, in natural units."""
    unobservable: tuple[UnobservableDirection, ...]
    """Unobservable directions, the worst first."""
    equations: int = 0
    """Number of residuals that carried weight, priors among them; 0 where nobody counted."""
    open_ways: NDArray = field(default_factory=lambda: np.zeros((0, 0)))
    """Changes of the parameters that nothing determines, each as large as `covariance` has it.
    Shape (e, k)."""

    @property
    def correlation(self) -> NDArray:
        """Correlations of the parameters. Shape (k, k)."""
        sigma = np.sqrt(np.maximum(np.diag(self.covariance), np.finfo(float).tiny))
        return self.covariance / np.outer(sigma, sigma)

    def sigma_of(self, slope: NDArray) -> float:
        """Return the standard deviation of what follows from the parameters.

        Args:
            slope: Its derivatives by the parameters. Shape (k,).

        Returns:
            inf where what nothing determines has a part in it.
        """
        for way in self.open_ways:
            if abs(float(way @ slope)) > _NO_PART * float(np.abs(way) @ np.abs(slope)):
                return np.inf
        return float(np.sqrt(max(float(slope @ self.covariance @ slope), 0.0)))

    def doubted(self, ways: NDArray) -> "Uncertainty":
        """Return the same with changes that nothing determines for a reason no Jacobian sees.

        Args:
            ways: The changes, as large as they may be. Shape (e, k).
        """
        return replace(
            self,
            covariance=self.covariance + ways.T @ ways,
            sigma=np.where((ways != 0.0).any(axis=0), np.inf, self.sigma),
            open_ways=np.vstack([self.open_ways.reshape(-1, len(self.names)), ways]),
        )

    def with_unobservable(self, names: tuple[str, ...], natural: NDArray) -> "Uncertainty":
        """Return the same with parameters unobservable for a reason the Jacobian cannot see.

        They are one more unobservable direction, where no other names one of them.

        Args:
            natural: Natural scale of each parameter; so far these may be off. Shape (k,).
        """
        own = [self.names.index(name) for name in names]
        found = self.doubted(np.diag(natural)[own])
        if any(set(names) & set(direction.names) for direction in self.unobservable):
            return found
        share = np.full(len(names), len(names) ** -0.5)
        direction = UnobservableDirection(names, share, np.inf)
        return replace(found, rank=self.rank - 1, unobservable=(*self.unobservable, direction))

    def told_together(self, names: Iterable[str]) -> "Uncertainty":
        """Return the same with no sigma of parameters of which only all together are told."""
        return replace(self, sigma=np.where(np.isin(self.names, list(names)), np.inf, self.sigma))

    @classmethod
    def from_jacobian(
        cls,
        names: tuple[str, ...],
        jacobian: NDArray,
        natural: NDArray,
        squared_residuals: float,
        observations: int,
        scatter: Sequence[NDArray] | None = None,
    ) -> "Uncertainty":
        """Analyse the whitened Jacobian at a solution, C = s^2 (J'J)^-1.

        Of residuals that do not scatter alike it is C = (J'J)^-1 J' diag(scatter) J (J'J)^-1
        (White 1980).

        Args:
            names: Free parameters. Length k.
            jacobian: Derivatives of the whitened residuals. Shape (m, k).
            natural: Natural scale of each parameter. Shape (k,).
            squared_residuals: Sum of squared whitened residuals.
            observations: Number of residuals that carry weight.
            scatter: Variance of each residual, where these are not alike: as it alone tells it, and
                as it is expected. Shapes (m,).

        Returns:
            The uncertainty. Without redundancy s^2 is taken as 1, the sigma assumed beforehand.
        """
        redundancy = observations - len(names)
        factor = squared_residuals / redundancy if redundancy > 0 else np.nan
        spread = np.sqrt(factor) if redundancy > 0 else 1.0
        scaled = jacobian * natural
        if scatter is not None and scatter[0].any():
            scaled, spread = _as_told(scaled, *scatter), 1.0
        # The triangular factor holds all there is to know of a tall matrix.
        triangle = np.linalg.qr(scaled, mode="r") if len(scaled) > len(names) else scaled
        _, values, vt = np.linalg.svd(triangle, full_matrices=True)
        values = np.concatenate([values, np.zeros(len(names) - len(values))])
        exact = values <= 1e-12 * max(values[0], 1e-300)
        least = np.where(exact, 1.0, values)
        sigma = np.where(exact, np.inf, spread / least)
        unobservable = exact | (sigma * np.abs(vt).max(axis=1) > UNOBSERVABLE_SIGMA)
        # A parameter with a small share in what nobody knows is uncertain by that share.
        most = UNKNOWN_SIGMA / np.abs(vt).max(axis=1)
        root = vt * np.minimum(sigma, most)[:, None] * natural
        directions = [
            _unobservable_direction(names, vt[i], float(sigma[i]))
            for i in np.flatnonzero(unobservable)
        ]
        by_way = _by_way(vt, sigma, np.finfo(float).eps * values[0] / least)
        lost = (by_way[sigma > most] > UNOBSERVABLE_SIGMA).any(axis=0)
        lost |= np.isin(names, [name for direction in directions for name in direction.names])
        return cls(
            names,
            root.T @ root,
            np.where(lost, np.inf, natural * np.sqrt(np.sum(by_way**2, axis=0))),
            float(factor),
            int(np.sum(~unobservable)),
            float(values[0] / values[-1]) if values[-1] > 0.0 else np.inf,
            tuple(sorted(directions, key=lambda d: -d.sigma)),
            observations,
            root[sigma > most],
        )


def _as_told(jacobian: NDArray, scatter: NDArray, expected: NDArray) -> NDArray:
    """Return a Jacobian of residuals of variance 1 that tell as much as some of others.

    With J = U S V' and W = U' diag(scatter) U = L L' it is L^-1 S V': its information inverted is
    V S^-1 W S^-1 V'. Residuals that scatter as expected give the W of that but for chance; W is
    drawn towards it by how much of what it differs chance makes (Ledoit, Wolf 2004, section 3.2).
    """
    u, values, vt = np.linalg.svd(jacobian, full_matrices=False)
    W, usual = ((u * one[:, None]).T @ u for one in (scatter, expected))
    by_chance = _DRAWN * float(np.sum((scatter * np.sum(u * u, axis=1)) ** 2))
    apart = float(np.sum((W - usual) ** 2))
    share = 1.0 if apart <= by_chance else by_chance / apart
    W = share * usual + (1.0 - share) * W
    return np.asarray(np.linalg.solve(np.linalg.cholesky(W), values[:, None] * vt))


def _by_way(vt: NDArray, sigma: NDArray, rounding: NDArray) -> NDArray:
    """Return what each direction adds to the sigma of each parameter, in natural units. (k, k).

    Rounding gives every parameter a share in what is as good as undetermined: it counts as none.
    """
    least = np.where(np.isinf(sigma), _NO_PART, 100.0 * rounding)
    taking = np.abs(vt) > least[:, None]
    return np.multiply(np.abs(vt), sigma[:, None], where=taking, out=np.zeros_like(vt))


def _unobservable_direction(
    names: tuple[str, ...], vector: NDArray, sigma: float
) -> UnobservableDirection:
    """Name the parameters that carry a null vector."""
    order = np.argsort(-np.abs(vector))
    order = order[np.abs(vector[order]) > 0.2 * np.abs(vector).max()]
    return UnobservableDirection(tuple(names[i] for i in order), vector[order], sigma)


def covariance_told_by(information: NDArray) -> NDArray:
    """Return the inverse of an information; what it does not tell is as good as unknown.

    Whoever leaves such directions out takes them for known.

    Args:
        information: H, in whatever units. Shape (k, k).

    Returns:
        Shape (k, k).
    """
    diagonal = np.diag(information)
    unit = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    alike = information / np.outer(unit, unit)
    try:
        lower = np.linalg.cholesky(alike)
    except np.linalg.LinAlgError:
        lower = np.zeros_like(alike)
    if (np.diag(lower) ** 2 > _WELL_TOLD).all():
        inverse = np.linalg.inv(lower) / unit
        return inverse.T @ inverse
    values, vectors = np.linalg.eigh(alike)
    values = np.maximum(values, _TOLD * values.max(initial=1.0))
    return (vectors / values) @ vectors.T / np.outer(unit, unit)


def root_of(covariance: NDArray) -> NDArray:
    """Return L with C = L L', without the directions in which C is zero.

    Of the correlation, for rounding is as large as the largest variance, beside which those of
    other units are nothing: lengths beside loads that hardly anything tells.

    Args:
        covariance: C. Shape (P, P).

    Returns:
        Shape (P, p).
    """
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(sigma > 0.0, sigma, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    # What is known stands beside what nobody knows: a micrometre beside thirty metres is 1e-15.
    kept = values > 1e-15 * values.max(initial=np.finfo(float).tiny)
    return size[:, None] * vectors[:, kept] * np.sqrt(values[kept])


def inverse_of(matrix: NDArray) -> NDArray:
    """Return the inverse of a covariance or an information, whatever units its parts have.

    A = D B D with D the root of its diagonal: A^-1 = D^-1 B^-1 D^-1.
    """
    size = np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)
    return 0.5 * (inverse + inverse.T)
