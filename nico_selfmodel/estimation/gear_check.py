"""Whether joints said to be read in rad or deg really are: what a freed gear would say."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.model import DhParameters

_LEAST_CHANGE = 0.02
_LEAST_SIGMAS = 5.0


@dataclass(frozen=True)
class DoubtfulGear:
    """A gear held at 1 that the data contradict."""

    name: str
    """Its parameter."""
    value: float
    """Where it would move, from one Gauss-Newton step."""
    sigma: float
    """Standard deviation of that."""


def doubtful_gears(
    observations: Observations,
    parameters: DhParameters,
    free: frozenset[str],
    held: frozenset[str],
    believed: NDArray,
) -> tuple[DoubtfulGear, ...]:
    """Test held gears: one step of least squares in which they may move.

    Args:
        observations: The training data.
        parameters: The solution.
        free: Parameters that were estimated.
        held: Gears held because their encoders read joint angles.
        believed: Rows that count. Boolean, shape (N,).

    Returns:
        Gears that would move by more than 2 % and five standard deviations, the worst first.
    """
    names = [name for name in parameters.names if name in free | held]
    columns = [parameters.names.index(name) for name in names]
    rows = observations.select(believed)
    p, jacobian = parameters.predict(rows.angles, rows.marker)
    design = jacobian[:, :, columns].reshape(-1, len(columns))
    residuals = (rows.p_WH - p).ravel()
    if len(residuals) <= len(columns) or not held:
        return ()
    scale = np.linalg.norm(design, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    step, _, rank, _ = np.linalg.lstsq(design / scale, residuals, rcond=1e-9)
    if rank < len(columns):
        return ()
    left = residuals - design / scale @ step
    variance = left @ left / (len(residuals) - len(columns))
    covariance = variance * np.linalg.inv((design / scale).T @ (design / scale))
    sigma, step = np.sqrt(np.diag(covariance)) / scale, step / scale
    values = parameters.values[columns]
    found = [
        DoubtfulGear(name, float(values[i] + step[i]), float(sigma[i]))
        for i, name in enumerate(names)
        if name in held and abs(step[i]) > max(_LEAST_CHANGE * values[i], _LEAST_SIGMAS * sigma[i])
    ]
    return tuple(sorted(found, key=lambda gear: -abs(gear.value - 1.0)))
