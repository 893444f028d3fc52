"""What bends in a learned arm, for people: millimetres at the hand, milliradians a joint."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.bending.bendable import GEAR
from nico_selfmodel.estimation.bending.implausible import (
    COUPLES,
    FAR_TURNS,
    LIFTS,
    NOT_ASKED,
    TURNS,
)
from nico_selfmodel.estimation.bending.ladder import Ladder
from nico_selfmodel.estimation.bending.steps import STEPS, Step
from nico_selfmodel.estimation.diagnosis.systematic_residuals import MUCH
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.arm.bending import EFFECTS, Bending
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.loaded_posture import loaded
from nico_selfmodel.names import refuse_unknown

WORDS = {
    "sag": "joints sag",
    "bearing_sag": "bearings give way",
    "backlash": "joints are behind their drives",
    "ripple": "gears or encoder discs ripple",
    "gear": "gears are a little off",
    "coupling": "drives are coupled",
}
"""What an effect is called in a sentence."""


_MUCH = float(np.log(MUCH))
"""Gain of unseen poses from which on what is no bend is most of what they miss."""
At = Callable[[Bending | None], tuple[NDArray, NDArray]]
"""Where tracked points are at the poses of a recording [m], shape (N, 3), and what joints turned,
shape (P, n), of a body that bends so."""


@dataclass(frozen=True, eq=False)
class EffectSize:
    """How much an effect moves a body at the poses of a recording."""

    effect: str
    """Its name, of `model.arm.bending.EFFECTS`."""
    hand: NDArray
    """How far it moves the tracked points [m]. Shape (N,)."""
    turns: NDArray
    """How far it turns each joint, largest over the poses [rad]. Shape (n,)."""


def arm_at(parameters: DhParameters, observations: Observations) -> At:
    """Return where an arm is at the poses of a recording, whatever bends in it."""
    rows = observations.angles, observations.marker, observations.approach
    q = (observations.angles - parameters.servos.offset) / parameters.servos.gear

    def at(bending: Bending | None) -> tuple[NDArray, NDArray]:
        turned = loaded(parameters.table, bending, q, observations.approach).q
        return parameters.with_bending(bending).points(*rows), turned

    return at


def _effect_sizes(bending: Bending | None, at: At) -> tuple[EffectSize, ...]:
    """Return what each learned effect does at a recording's poses, one taken away at a time."""
    if bending is None:
        return ()
    whole, turned = at(bending)
    found = []
    for effect in EFFECTS:
        if effect not in bending.effects:
            continue
        less = bending.with_effects(*(e for e in bending.effects if e != effect))
        points, rest = at(less)
        moved = np.linalg.norm(whole - points, axis=1)
        found.append(EffectSize(effect, moved, np.abs(turned - rest).max(axis=0)))
    return tuple(found)


def _bends_words(ladder: Ladder, bending: Bending | None, at: At) -> str:
    """Say which effects move tracked points by how much, and which joint most."""
    found = {
        size.effect: f" by up to {1e3 * size.hand.max():.2g} mm at the hand{_most(bending, size)}"
        for size in _effect_sizes(bending, at)
    }
    found[GEAR] = _farthest_gear(ladder)
    return ", ".join(f"{WORDS[e]}{found.get(e, '')}" for e in ladder.kept)


def _most(bending: Bending | None, size: EffectSize) -> str:
    """Name the joint that an effect turns most; what turns none, as bearings, names none."""
    if bending is None or not size.turns.any():
        return ""
    return f" ({bending.joints[int(np.argmax(size.turns))]!r} most)"


def _farthest_gear(ladder: Ladder) -> str:
    """Name the gear that a unit tells and that is off most."""
    bent, fit = ladder.bent, ladder.fit
    if bent is None or fit is None:
        return ""
    told = fit.groups.get(GEAR, ())
    values = {n: v for n, v in zip(bent.names, bent.values.tolist(), strict=True) if n in told}
    worst = max(values, key=lambda name: abs(values[name] - 1.0), default=None)
    return "" if worst is None else f" (`{worst}` is {values[worst]:.4f})"


def kept_words(ladder: Ladder, bending: Bending | None, at: At) -> list[str]:
    """Say what was found to bend, and what unseen poses gain by it."""
    if not ladder.adopted:
        return []
    if not ladder.kept:
        return [_hidden_words(size) for size in _effect_sizes(bending, at)]
    before, after = ladder.unseen
    most = _bends_words(ladder, bending, at)
    return [f"{most}: unseen poses {before:.2g} -> {after:.2g} {ladder.unit}"]


def _hidden_words(size: EffectSize) -> str:
    return (
        f"{WORDS[size.effect]} by up to {1e3 * size.hand.max():.2g} mm at the hand, which other "
        "errors hide in unseen poses: learned, and its uncertainty counted, but not claimed"
    )


def bending_warnings(ladder: Ladder, at: At) -> list[str]:
    """Say what a body would gain by effects that it was not allowed, or by one that lifts it."""
    if ladder.kept and ladder.bent is not None and not ladder.adopted:
        before, after = ladder.unseen
        bends = _bends_words(ladder, ladder.bent.bending, at)
        return [
            f"would meet unseen poses to {after:.2g} {ladder.unit} in place of {before:.2g} "
            f"{ladder.unit}: {bends} (--effects auto)"
        ]
    asked = {step.effect: step.reason for step in ladder.steps}
    refused = {e: why for e, why in asked.items() if why in (LIFTS, TURNS, COUPLES)}
    refused |= {e: asked.get(e, NOT_ASKED) for e in ladder.wanted if asked.get(e, NOT_ASKED)}
    return [f"{effect} is not kept: {why}" for effect, why in refused.items()]


def bending_faults(ladder: Ladder) -> list[str]:
    """Say which joint turns too far for a bend, where that is most of what unseen poses miss."""
    far = [s for s in ladder.steps if s.joint and s.reason in (TURNS, FAR_TURNS)]
    step = max(far, key=lambda step: step.gain, default=None)
    if ladder.adopted or step is None or step.gain < max(_MUCH, 2.0 * step.gain_sigma):
        return []
    return [
        f"{WORDS[step.effect]}: {step.joint!r} would turn by more than 3 deg beside its readings, "
        f"which is no bend, and unseen poses would be met to {step.after:.2g} in place of "
        f"{step.before:.2g} {ladder.unit}: check its readings, unit, gear and what turns off centre"
    ]


def bending_json(
    ladder: Ladder, bending: Bending | None, at: At, joints: Sequence[str]
) -> dict[str, Any] | None:
    """Return what was asked and what bends, for `result.json`; None where nothing was asked.

    Args:
        bending: What bends in the body as learned.
        at: Where it is.
    """
    if not ladder.steps:
        return None
    sizes = _effect_sizes(bending, at)
    return {
        "effects": list(ladder.kept) if ladder.adopted else [],
        "up": None if bending is None else bending.up.tolist(),
        f"unseen_{ladder.unit}": {"rigid": ladder.unseen[0], "bent": ladder.unseen[1]},
        "tried": [_step_json(step, ladder.unit) for step in ladder.steps],
        "hand_mm": {
            s.effect: {"max": 1e3 * float(s.hand.max()), "mean": 1e3 * float(s.hand.mean())}
            for s in sizes
        },
        "joints_mrad": {
            s.effect: dict(zip(joints, (1e3 * s.turns).tolist(), strict=True)) for s in sizes
        },
    }


def _step_json(step: Step, unit: str) -> dict[str, Any]:
    return {
        "effect": step.effect,
        "kept": step.kept,
        f"before_{unit}": step.before,
        f"after_{unit}": step.after,
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
        refuse_unknown("effect", word, ("auto", "none", *STEPS))
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
