"""Which parameters must not be read as if they were known."""

import numpy as np

from nico_selfmodel.estimation import KinematicCalibration


def blind_parameters(calibration: KinematicCalibration) -> frozenset[str]:
    """Return the parameters that take part in a direction which the data do not determine.

    Their standard deviations may be finite, where something does determine them a little; what is
    known of a blind direction is still less than its natural scale.

    Args:
        calibration: What was learned.

    Returns:
        Names of parameters; none where no uncertainty is known.
    """
    uncertainty = calibration.uncertainty
    if uncertainty is None:
        return frozenset()
    pairs = zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True)
    unknown = {name for name, sigma in pairs if not np.isfinite(sigma)}
    return frozenset(unknown.union(*(direction.names for direction in uncertainty.blind)))
