"""What is no bend, however well it fits: sag upward, gears far off, joints that turn by degrees."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.bendable import GEAR, Bendable, Posture
from nico_selfmodel.estimation.bending.effect_fit import EffectFit
from nico_selfmodel.estimation.diagnosis.gear_check import DoubtfulGear
from nico_selfmodel.model.arm.bending import BEARING, COUPLING, SAG

LIFTS = "it would lift the arm: something else is explained, or the arm compensates already"
"""Why a sag of the wrong sign goes."""
NOT_ASKED = (
    "it was not asked: there are fewer than 15 poses, no gear that a unit tells, no column "
    "`approach.<joint>` that tells both sides, or a held value that the data contradict"
)
"""Why an effect that the user named was not tried."""
TURNS = "joints would turn by more than 3 deg: that is no bend"
"""Why what turns joints too far goes."""
FAR_TURNS = "joints that turn farther than any bend explain it better"
"""Why all else goes then."""
TILTS = "bearings would tilt by more than 3 deg: that is no bend"
"""The same of what gives way across joints."""
COUPLES = "a joint would turn by more than a tenth of another's angle: check their readings"
"""Why a coupling that is too strong goes."""
_LARGEST_COUPLING = 0.1
"""Of the other joint's angle; coupled drives are geometry, and turn with the whole of it."""
_SURE = 2.0
"""Standard deviations by which gravity's work must be negative."""
_LARGEST = np.radians(3.0)
"""A joint that turns more than this has not bent."""
_LARGEST_GEAR = 0.01
"""A gear that is told and off by more is another gear, a wrong unit or a wrong sign."""


def implausible(fit: EffectFit, body: Bendable) -> str:
    """Say why a fit is no bend; empty where it may be one."""
    bent = fit.parameters.with_values(fit.values)
    if np.any(bent.gears <= 0.0):
        return "a gear would turn negative"
    if {SAG, BEARING} & set(fit.groups) and lifts(fit, body):
        return LIFTS
    gear = gear_fault(fit)
    if gear is not None:
        return no_gear(gear)
    bending = bent.bending
    assert bending is not None
    if COUPLING in bending.effects:
        if np.abs(bending.coupling).max() > _LARGEST_COUPLING:
            return COUPLES
        rest = (effect for effect in bending.effects if effect != COUPLING)
        bent = bent.with_bending(bending.with_effects(*rest))
    if _turned(bent, body).max() > _LARGEST:
        return TURNS
    return TILTS if BEARING in bending.effects and _tilt(bent, body) > _LARGEST else ""


def farthest_turned(fit: EffectFit, body: Bendable) -> str:
    """Return the joint that a fit turns farthest beside its readings."""
    bent = fit.parameters.with_values(fit.values)
    assert bent.bending is not None
    return bent.bending.joints[int(np.argmax(_turned(bent, body)))]


def _turned(bent: Posture, body: Bendable) -> NDArray:
    """Return by how much joints turn at most, about where they stand on the whole [rad]. (n,)."""
    turns = body.turns(bent)
    return np.abs(turns - turns.mean(axis=0)).max(axis=0)


def _tilt(bent: Posture, body: Bendable) -> float:
    """Return by how much bearings tilt at most, about where they stand on the whole [rad]."""
    assert bent.bending is not None
    tilts = body.moments(bent)[:, :, :2] * bent.bending.bearing_sag[:, None, None]
    return float(np.linalg.norm(tilts - tilts.mean(axis=1, keepdims=True), axis=2).max())


def lifts(fit: EffectFit, body: Bendable) -> bool:
    """Whether what gives way lifts what it carries, surely: gravity's work on it is negative.

    A joint that turns by k m under a moment m lowers what it carries by k m^2, and so does a
    bearing across it. Each may take a little of the other's part, whatever its sign.
    """
    bent = fit.parameters.with_values(fit.values)
    bending = bent.bending
    assert bending is not None
    across_x, across_y, about = np.sum(body.moments(bent) ** 2, axis=1).T
    weights = np.concatenate([about, across_x + across_y]).tolist()
    names = (*bending.names_of(SAG), *bending.names_of(BEARING))
    work = np.concatenate([bending.sag, bending.bearing_sag]) @ weights
    return bool(work < -_SURE * fit.sigma_of(dict(zip(names, weights, strict=True))))


def gear_fault(fit: EffectFit) -> DoubtfulGear | None:
    """Return the gear that is so far from what its unit tells that it is a fault; None if none."""
    names, values = fit.parameters.names, fit.values
    told = {name: float(values[names.index(name)]) for name in fit.groups.get(GEAR, ())}
    worst = max(told, key=lambda name: abs(told[name] - 1.0), default=None)
    if worst is None or abs(told[worst] - 1.0) <= _LARGEST_GEAR:
        return None
    return DoubtfulGear(worst, told[worst], fit.sigma_of({worst: 1.0}))


def no_gear(gear: DoubtfulGear) -> str:
    """Say why an effect goes where a gear contradicts its unit."""
    return (
        f"`{gear.name}`, which its unit tells, would have to be {gear.value:.3f}: that is no bend"
    )
