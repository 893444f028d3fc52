"""A joint of a tree as its encoder shows it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import check_keys, integer_value, number_value, text_value
from nico_selfmodel.model.encoder_units import ANGLES, COUNTS, LENGTHS, check_unit, unit_size
from nico_selfmodel.model.tree.body_tree import (
    FLANGE,
    FREE,
    MOTIONS,
    PRISMATIC,
    REVOLUTE,
    WHOLE_POSES,
    WORLD,
    WORLD_NAME,
)
from nico_selfmodel.names import check_name, listed, shown

_POSE = "pose"
"""Unit of joints that no encoder reads: metres and radians of their whole poses."""
UNITS = {
    REVOLUTE: ANGLES,
    PRISMATIC: LENGTHS,
    FLANGE: (_POSE,),
    FREE: (_POSE,),
}
"""Units in which each kind of joint is read."""
_LIMITS = ("lower", "upper")
_KEYS = (
    "name", "parent", "motion", "encoder_unit", "counts_per_turn", "sign", "follows", *_LIMITS,
)  # fmt: skip


@dataclass(frozen=True)
class LinkJoint:
    """A joint, what carries it, and how it is read.

    Raises:
        ValueError: If a value is not valid.
    """

    name: str
    """Its name; the link beyond it is called the same."""
    parent: str = WORLD_NAME
    """The joint whose link carries it, or `world`."""
    motion: str = REVOLUTE
    """`revolute`, `prismatic`, `flange`: the whole pose is what a controller tells, or `free`:
    nobody tells it, as of a board in a hand, and markers of known places do."""
    encoder_unit: str = "rad"
    """Unit of the readings, of `UNITS`."""
    counts_per_turn: float | None = None
    """Counts of one turn of the encoder; given with `counts`, never otherwise."""
    sign: int = 1
    """+1, or -1 where the readings are known to fall as the joint moves forward."""
    follows: Mapping[str, float] = field(default_factory=dict)
    """Ratios to the joints that move it; a joint that follows has no encoder."""
    lower: float | None = None
    """Least reading that it can reach, if known."""
    upper: float | None = None
    """Largest reading that it can reach, if known."""

    def __post_init__(self) -> None:
        """Check the values."""
        check_name(self.name, "the name of a joint")
        if self.name == WORLD_NAME:
            raise ValueError(f"a joint cannot be called {WORLD_NAME!r}")
        if self.motion not in MOTIONS:
            raise ValueError(
                f"joint {self.name!r}: motion must be one of {', '.join(MOTIONS)}, got "
                f"{shown(self.motion)}"
            )
        check_unit(self.name, self.encoder_unit, self.counts_per_turn, UNITS[self.motion])
        if self.sign not in (1, -1):
            raise ValueError(f"joint {self.name!r}: sign must be 1 or -1, got {self.sign}")
        if any(ratio == 0.0 for ratio in self.follows.values()):
            raise ValueError(
                f"joint {self.name!r}: ratios of 'follows' must not be 0, got "
                f"{dict(self.follows)}: leave out what does not move it"
            )
        if self.follows and self.motion in WHOLE_POSES:
            raise ValueError(f"joint {self.name!r}: a {self.motion} joint follows no joint")
        limits = [value for value in (self.lower, self.upper) if value is not None]
        if not np.isfinite(limits).all() or not limits == sorted(limits):
            raise ValueError(
                f"joint {self.name!r}: lower and upper must be finite readings, lower below upper, "
                f"got {self.lower} and {self.upper}; leave out what is not known"
            )

    @property
    def si_per_unit(self) -> float:
        """Size of one unit of the reading, with the wiring's sign [rad or m]."""
        if self.encoder_unit == _POSE:
            return float(self.sign)
        return self.sign * unit_size(self.encoder_unit, self.counts_per_turn)

    @property
    def is_read(self) -> bool:
        """Whether an encoder tells its displacement."""
        return not self.follows and self.motion not in WHOLE_POSES

    @property
    def gear_known(self) -> bool:
        """Whether a reading is the joint's displacement, in its unit."""
        return self.encoder_unit != COUNTS

    @classmethod
    def from_mapping(cls, entry: Any, before: str, where: str) -> "LinkJoint":
        """Make a joint from its entry in a YAML file.

        Args:
            before: The joint before, which is the parent unless the entry says otherwise.
            where: Place for messages.

        Raises:
            DataError: If the entry is not valid.
        """
        if not isinstance(entry, Mapping):
            raise DataError(f"{where}: a joint must be a mapping with 'name', got {shown(entry)}")
        check_keys(entry, _KEYS, where)
        follows = entry.get("follows") or {}
        if not isinstance(follows, Mapping):
            raise DataError(f"{where}: 'follows' must be ratios by joint, got {shown(follows)}")
        sign = integer_value(entry, "sign", where)
        motion = text_value(entry, "motion", where, REVOLUTE)
        unit = text_value(entry, "encoder_unit", where, UNITS.get(motion, ("rad",))[0])
        try:
            return cls(
                text_value(entry, "name", where),
                text_value(entry, "parent", where, WORLD_NAME if motion == FREE else before),
                motion,
                unit,
                number_value(entry, "counts_per_turn", where),
                1 if sign is None else sign,
                {str(k): number_value(follows, k, where) or 0.0 for k in follows},
                *(number_value(entry, key, where) for key in _LIMITS),
            )
        except ValueError as error:
            raise DataError(f"{where}: {error}") from None

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry of this joint in a YAML file."""
        entry: dict[str, Any] = {
            "name": self.name,
            "parent": self.parent,
            "motion": self.motion,
            "encoder_unit": self.encoder_unit,
        }
        if self.counts_per_turn is not None:
            entry["counts_per_turn"] = self.counts_per_turn
        if self.sign != 1:
            entry["sign"] = self.sign
        if self.follows:
            entry["follows"] = dict(self.follows)
        limits = {key: getattr(self, key) for key in _LIMITS}
        return entry | {key: value for key, value in limits.items() if value is not None}


def parents_of(joints: tuple[LinkJoint, ...]) -> NDArray:
    """Return the index of each joint's parent, `WORLD` at a root. Shape (n,).

    Raises:
        DataError: If a parent is no joint that stands before its child.
    """
    names = [joint.name for joint in joints]
    out = []
    for i, joint in enumerate(joints):
        if joint.parent != WORLD_NAME and joint.parent not in names[:i]:
            cure = "list the parent first" if joint.parent in names else "give it as a joint"
            raise DataError(
                f"joint {joint.name!r} is carried by {joint.parent!r}, which is no joint before "
                f"it; there are {listed(names[:i], joint.parent) or 'none'}: {cure}"
            )
        out.append(WORLD if joint.parent == WORLD_NAME else names.index(joint.parent))
    return np.array(out, dtype=int)


def coupling_of(joints: tuple[LinkJoint, ...]) -> NDArray:
    """Return displacements of all joints by those that are read. Shape (n, n).

    Raises:
        DataError: If a joint follows one that does not exist, or that follows itself.
    """
    names = [joint.name for joint in joints]
    coupling = np.diag([0.0 if joint.follows else 1.0 for joint in joints])
    for i, joint in enumerate(joints):
        for other, ratio in joint.follows.items():
            if other not in names:
                raise DataError(
                    f"joint {joint.name!r} follows {other!r}, which is no joint; there are "
                    f"{listed(names, other)}"
                )
            lead = joints[names.index(other)]
            if lead.follows or other == joint.name:
                raise DataError(
                    f"joint {joint.name!r} follows {other!r}, which follows "
                    f"{listed(list(lead.follows))} itself: let both follow joints with encoders"
                )
            coupling[i, names.index(other)] = ratio
    return coupling
