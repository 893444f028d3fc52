"""What bends as plain data, as files of self-models and bodies hold it."""

from collections.abc import Mapping
from typing import Any

from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.document_values import mapping, numbers, texts
from nico_selfmodel.names import listed

_LARGEST = 10.0
"""Of any number that bends [rad, rad/m, m or 1]."""


def bending_document(bending: Bending) -> dict[str, Any]:
    """Name every number that was learned; what was not is not written."""
    return {
        "effects": list(bending.effects),
        "up": bending.up.tolist(),
        "joints": {
            joint: {"load": load, "pivot": pivot}
            for joint, load, pivot in zip(
                bending.joints, bending.loads.tolist(), bending.pivots.tolist(), strict=True
            )
        },
        "values": dict(zip(bending.names, bending.values.tolist(), strict=True)),
    }


def bending_of(entry: Mapping[str, Any]) -> Bending:
    """Read what `bending_document` wrote.

    Raises:
        KeyError: If something is missing.
        ValueError: If something is not valid.
    """
    joints = mapping(entry["joints"], "bending.joints")
    own = {joint: mapping(joints[joint], f"bending of {joint}") for joint in joints}
    still = Bending.none(
        tuple(joints),
        numbers(entry["up"], "bending.up"),
        numbers([part["load"] for part in own.values()], "loads"),
        numbers([part["pivot"] for part in own.values()], "pivots"),
    ).with_effects(*texts(entry["effects"], "bending.effects"))
    values = mapping(entry["values"], "bending.values")
    if set(values) != set(still.names):
        strange = sorted(set(values) ^ set(still.names))
        raise ValueError(f"bending.values must name what its effects have, see {listed(strange)}")
    found = numbers([values[name] for name in still.names], "bending.values", _LARGEST)
    return still.with_values(found)
