"""What bends in a learned arm, for people: millimetres at the hand, milliradians a joint."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.bending.ladder import Ladder
from nico_selfmodel.estimation.bending.steps import STEPS, Step
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.arm.bending import EFFECTS, Bending
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.loaded_posture import loaded
from nico_selfmodel.names import did_you_mean

WORDS = {
    "sag": "joints sag",
    "bearing_sag": "bearings give way",
    "backlash": "joints are behind their drives",
    "ripple": "gears or encoder discs ripple",
    "gear": "gears are a little off",
    "coupling": "drives are coupled",
}
"""What an effect is called in a sentence."""


@dataclass(frozen=True, eq=False)
class EffectSize:
    """How much an effect moves an arm at the poses of a recording."""

    effect: str
    """Its name, of `model.arm.bending.EFFECTS`."""
    hand: NDArray
    """How far it moves the tracked points [m]. Shape (N,)."""
    turns: NDArray
    """How far it turns each joint, largest over the poses [rad]. Shape (n,)."""


def effect_sizes(parameters: DhParameters, observations: Observations) -> tuple[EffectSize, ...]:
    """Return what each learned effect does at the poses of a recording, one taken away at a time.

    Args:
        parameters: The arm.
        observations: Where it was.
    """
    bending = parameters.bending
    if bending is None:
        return ()
    rows = observations.angles, observations.marker, observations.approach
    q = (observations.angles - parameters.servos.offset) / parameters.servos.gear
    whole, side = parameters.points(*rows), observations.approach
    turned = loaded(parameters.table, bending, q, side).q
    found = []
    for effect in EFFECTS:
        if effect not in bending.effects:
            continue
        less = _without(bending, effect)
        rest = DhParameters(parameters.table, parameters.servos, parameters.turn, less)
        moved = np.linalg.norm(whole - rest.points(*rows), axis=1)
        turns = np.abs(turned - loaded(parameters.table, less, q, side).q).max(axis=0)
        found.append(EffectSize(effect, moved, turns))
    return tuple(found)


def _without(bending: Bending, effect: str) -> Bending:
    return bending.with_effects(*(e for e in bending.effects if e != effect))


def bending_json(
    ladder: Ladder, parameters: DhParameters, observations: Observations
) -> dict[str, Any] | None:
    """Return what was asked and what bends, for `result.json`; None where nothing was asked.

    Args:
        ladder: What was asked.
        parameters: The arm as learned.
        observations: What it was learned from.
    """
    if not ladder.steps:
        return None
    sizes = effect_sizes(parameters, observations)
    bending = parameters.bending
    return {
        "effects": list(ladder.kept) if ladder.adopted else [],
        "up": None if bending is None else bending.up.tolist(),
        "unseen_mm": {"rigid": ladder.unseen[0], "bent": ladder.unseen[1]},
        "tried": [_step_json(step) for step in ladder.steps],
        "hand_mm": {
            s.effect: {"max": 1e3 * float(s.hand.max()), "mean": 1e3 * float(s.hand.mean())}
            for s in sizes
        },
        "joints_mrad": {
            s.effect: dict(zip(observations.joints, (1e3 * s.turns).tolist(), strict=True))
            for s in sizes
        },
    }


def _step_json(step: Step) -> dict[str, Any]:
    return {
        "effect": step.effect,
        "kept": step.kept,
        "before_mm": step.before,
        "after_mm": step.after,
        "gain": step.gain,
        "gain_sigma": step.gain_sigma,
        "evidence": step.worth,
        "reason": step.reason,
    }


def effects_of(text: str) -> tuple[str, ...]:
    """Read `--effects`: auto, none, or some of them with commas.

    Raises:
        ValueError: If one has no such name.
    """
    if text == "auto":
        return STEPS
    if text == "none":
        return ()
    words = [word.strip() for word in text.split(",")]
    for word in words:
        if word not in STEPS:
            hint = did_you_mean(word, STEPS) or "."
            raise ValueError(
                f"--effects: no effect {word!r}{hint} There are auto, none, {', '.join(STEPS)}"
            )
    return tuple(effect for effect in STEPS if effect in words)


def up_of(text: str | None) -> NDArray | None:
    """Read `--up`: three numbers with commas, of any length but none.

    Raises:
        ValueError: If they are not three numbers, or point nowhere.
    """
    if text is None:
        return None
    words: Sequence[str] = text.split(",")
    try:
        up = np.array([number_of_word(word, "--up") for word in words])
    except DataError as error:
        raise ValueError(str(error)) from None
    length = float(np.linalg.norm(up))
    if up.shape != (3,) or not length > 0.0:
        raise ValueError(f"--up must be a direction as three numbers, such as 0,0,1, got {text}")
    return up / length
