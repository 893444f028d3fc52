"""Whether joints said to be read in rad or deg really are: what a freed gear would say."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from nico_selfmodel.estimation.diagnosis.score_test import ArmTest, Score
from nico_selfmodel.model.arm.dh_parameters import DhParameters

_LEAST_CHANGE = 0.02
LEAST_SIGMAS = 5.0
_NEAR = 0.1
"""How far from 1 a gear may be that one step tells."""
AS_MUCH = 0.8
"""Part of what waves in a joint's angle explain that its gear must explain by itself."""


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
    test: ArmTest, parameters: DhParameters, held: frozenset[str], ripples: Mapping[str, Score]
) -> tuple[DoubtfulGear, ...]:
    """Test held gears: one step of least squares in which they may move.

    Args:
        test: Residuals at the solution.
        parameters: The solution.
        held: Gears held because their encoders read joint angles.
        ripples: What waves in a joint's angle explain, by joint: over a part of the turn they look
            like a gear.

    Returns:
        Gears that would move by more than 2 % and five standard deviations, the worst first.
    """
    columns = [i for i, name in enumerate(parameters.names) if name in held]
    if not columns:
        return ()
    by_gear = test.linear.jacobian
    score = test.of(by_gear[:, :, columns])
    found = []
    for i, step, sigma in zip(columns, score.values, score.sigma, strict=True):
        value, name = float(parameters.values[i]), parameters.names[i]
        if abs(step) <= max(_LEAST_CHANGE * value, LEAST_SIGMAS * sigma):
            continue
        wave = ripples.get(name.removesuffix(".gear"))
        if wave is None or test.of(by_gear[:, :, [i]]).gain > AS_MUCH * wave.gain:
            found.append(DoubtfulGear(name, value + float(step), float(sigma)))
    return tuple(sorted(found, key=lambda gear: -abs(gear.value - 1.0)))


def gear_words(gears: Iterable[DoubtfulGear]) -> list[str]:
    """Say which gears the data contradict, and what to do.

    One step tells how large a gear is where that is near: far from it other joints go along.
    """
    said = []
    for gear in gears:
        wanted = f"about {gear.value:.4g} (+- {gear.sigma:.2g})"
        if abs(gear.value - 1.0) > _NEAR:
            wanted = "one that is far from it"
        said.append(
            f"`{gear.name}` is held at 1 because the encoder is said to read joint angles, but the "
            f"data ask for {wanted}: correct the unit, or add --free {gear.name}"
        )
    return said
