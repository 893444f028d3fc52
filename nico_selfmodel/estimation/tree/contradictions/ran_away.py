"""Adjustments that went where no body is: what nothing holds grows without end."""

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_JOINT_NOISE
from nico_selfmodel.estimation.tree.contradictions.standing_still import dead_encoders
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import BodyParameters
from nico_selfmodel.estimation.tree.tree_setup import TreeSetup
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.model.tree.body_tree import REVOLUTE
from nico_selfmodel.names import listed

_FARTHEST = 100.0
"""Times the largest length of the first body, or turns in rad, that no body is from there."""
_SMALLEST = 0.1
"""Size of a body of which nothing is known [m]."""

CHECK_READINGS = (
    "check units, the pairing of readings and observations, and whether something moved"
)
"""What joints whose noise would be none may come of."""


def noisy_joints(seen: TreeObservations, solution: TreeSolution) -> dict[str, float]:
    """Return joints that turn and whose noise would be none, with it [rad]."""
    joints, noise = seen.data.joints, solution.noise.joint.tolist()
    return {
        joints[i].name: sigma
        for (i, _), sigma in zip(seen.noisy_joints, noise, strict=True)
        if joints[i].motion == REVOLUTE and sigma > LARGEST_JOINT_NOISE
    }


def noise_words(turning: Mapping[str, float], cause: str = CHECK_READINGS) -> str:
    """Say that joints would have to be so noisy that they tell nothing; empty where none would.

    Args:
        turning: See `noisy_joints`.
        cause: What it may come of.
    """
    if not turning:
        return ""
    return (
        f"joint noise would have to be {np.degrees(max(turning.values())):.1f} deg to explain the "
        f"data ({listed(sorted(turning))}): {cause}"
    )


def what_led_away(seen: TreeObservations, solution: TreeSolution, setup: TreeSetup) -> str:
    """Say what an adjustment may have run away for: encoders, noise, or a told length.

    Args:
        seen: What was seen.
        solution: Where it ended.
        setup: What was free.
    """
    told = {name: mean for name, (mean, _) in setup.priors.items()} | dict(setup.fixed)
    return (
        dead_encoders(seen.data, seen.data.joint_names)
        or noise_words(noisy_joints(seen, solution))
        or too_short(setup.scale_from, told)
    )


def too_short(scale_from: str | None, told: Mapping[str, float]) -> str:
    """Say that one told length is all that tells how large a body is; empty where it is not.

    Args:
        scale_from: What tells lengths: `TreeSetup.scale_from`.
        told: Values that the user knows, by the parameters' names.
    """
    if scale_from is None or scale_from not in told:
        return ""
    return (
        f"how large all is only `{scale_from}` = {told[scale_from]:.3g} m tells, which may as well "
        "be 0 by what was recorded: give a longer length (--fix NAME=VALUE), a distance of two "
        f"markers, or leave `{scale_from}` free"
    )


def check_that_it_stayed(
    parameters: BodyParameters,
    start: NDArray,
    values: NDArray,
    cause: str = "",
    lost: Collection[str] = (),
) -> None:
    """Refuse a body that left all bounds: it is no answer, however small its residuals are.

    Args:
        parameters: Of the body.
        start: Where it began. Shape (P,).
        values: Where it ended. Shape (P,).
        cause: What may have led it away, if anything is known.
        lost: Markers that may be anywhere.

    Raises:
        NotConvergedError: If a length is a hundred times as large as the largest at first, a
            rotation vector a hundred radians long, or any of them no number; it names the worst.
    """
    layout = parameters.layout
    units = np.array(layout.units)
    began, ended = (parameters.layout_values(v) for v in (start, values))
    most = np.where(units == "m", np.abs(began[units == "m"]).max(initial=_SMALLEST), 1.0)
    moved = np.isin(units, ("m", "rad")) & (ended != began)
    moved &= ~np.isin([name.rpartition(".")[0] for name in layout.names], [*lost])
    far = np.where(moved, np.nan_to_num(np.abs(ended) / most, nan=np.inf), 0.0)
    worst = int(np.argmax(far))
    if far[worst] > _FARTHEST:
        name, unit = layout.names[worst], units[worst]
        cause = cause or (
            "nothing that was recorded holds it: give a value "
            f"(--fix {name}=VALUE) or what it is about (--prior {name}=VALUE,SIGMA), free less, or "
            "record what tells it"
        )
        raise NotConvergedError(
            f"the adjustment ran away: {name} went from {began[worst]:.3g} {unit} to "
            f"{ended[worst]:.3g}, where no body is; {cause}"
        )
