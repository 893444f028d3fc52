"""Which camera parameters are held, freed or given a prior."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters, priors_of
from nico_selfmodel.model.cameras.projection import FISHEYE, LENSES, POLYNOMIAL
from nico_selfmodel.model.cameras.rig_parameters import each_lens, rig_names
from nico_selfmodel.names import listed, refuse_unknown
from nico_selfmodel.optimization.robust_solve import ROBUST_METHODS

T = TypeVar("T")

_NOMINAL = ("skew", "cx", "cy", "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
AUTO = "auto"
"""Let `lens_choice.lens_of` choose the lens."""
HELD_BY_DEFAULT = ("skew", "p1", "p2")
"""Held at zero unless asked for."""


@dataclass(frozen=True)
class CameraOptions:
    """What is fixed, free or known beforehand; a name without a camera (`k3`) means all."""

    tangential: bool = False
    """Free p1 and p2."""
    aspect: float | None = None
    """Hold fy / fx at this ratio."""
    pinned: Mapping[str, float | None] = field(default_factory=dict)
    """Parameter -> value; None holds the nominal one: image centre, no skew, no distortion."""
    freed: frozenset[str] = frozenset()
    """Parameters to free of those `HELD_BY_DEFAULT`."""
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Parameter -> mean and standard deviation."""
    lens: str | Mapping[str, str] = POLYNOMIAL
    """Of all cameras, one of `model.cameras.projection.LENSES`, or `AUTO`; or of each by name."""
    loss: str = "trimmed"
    """`trimmed` leaves out boards that fit ten times worse than the rest; or one of `LOSSES`."""

    def __post_init__(self) -> None:
        """Check what can be checked without the data."""
        refuse_unknown("loss", self.loss, ROBUST_METHODS)
        if isinstance(self.lens, str):
            refuse_unknown("lens", self.lens, (AUTO, *LENSES))
        else:
            for lens in self.lens.values():
                refuse_unknown("lens", lens, LENSES)
        if self.aspect is not None and not self.aspect > 0.0:
            raise ValueError(f"aspect must be positive, got {self.aspect}")

    @property
    def told(self) -> str:
        """What was told of numbers, as it is told at the command line; empty if nothing was."""
        fixed = [f"--fix {name}={v:g}" for name, v in self.pinned.items() if v is not None]
        priors = [f"--prior {name}={v:g},{sigma:g}" for name, (v, sigma) in self.priors.items()]
        return " ".join([*fixed, *priors])

    @classmethod
    def from_text(
        cls,
        pin: Sequence[str] = (),
        free: Sequence[str] = (),
        prior: Sequence[str] = (),
        lens: str = POLYNOMIAL,
        **others: object,
    ) -> "CameraOptions":
        """Read the command line's words.

        Args:
            pin: NAME or NAME=VALUE.
            free: NAME.
            prior: NAME=MEAN,SIGMA.
            lens: A lens of all, or CAMERA=LENS of each with commas between.
            **others: As they are.

        Raises:
            ValueError: If a value is not a number, or a name is both fixed and freed.
        """
        chosen, priors = FixedParameters.from_text(pin, free), priors_of(prior)
        kind = _lens_of(lens)
        known = {"pinned": chosen.pinned, "freed": chosen.freed, "priors": priors}
        return cls(**known, lens=kind, **others)  # type: ignore[arg-type]

    def lenses(self, cameras: Sequence[str]) -> tuple[str, ...]:
        """Return the lens of each of some cameras.

        Raises:
            ValueError: If lenses are given by name, and not of just these cameras.
        """
        if isinstance(self.lens, str):
            return each_lens(self.lens, len(cameras))
        for name in self.lens:
            refuse_unknown("camera", name, cameras)
        missing = [name for name in cameras if name not in self.lens]
        if missing:
            raise ValueError(
                f"no lens is given of {listed(missing)}: name one for every camera, as "
                f"{','.join(f'{name}={POLYNOMIAL}' for name in cameras)}"
            )
        return tuple(self.lens[name] for name in cameras)

    def of_camera(self, camera: str) -> "CameraOptions":
        """Return what concerns the inside of one camera."""
        lens = self.lens if isinstance(self.lens, str) else self.lens[camera]
        inside = set(rig_names((camera,), lens))
        inside |= {n.partition(".")[2] for n in inside}
        return replace(
            self,
            lens=lens,
            pinned={n: v for n, v in self.pinned.items() if n in inside},
            freed=self.freed & inside,
            priors={n: v for n, v in self.priors.items() if n in inside},
        )

    def held(self, names: tuple[str, ...]) -> dict[str, float | None]:
        """Return the parameters that stay, with their values; None means the nominal one.

        Args:
            names: All camera parameters of the problem.

        Raises:
            ValueError: If an option names a parameter that does not exist, or pins one without a
                value that has no nominal one.
        """
        freed = set(by_full_name(dict.fromkeys(self.freed), names))
        held: dict[str, float | None] = {}
        for name in names:
            what = name.rpartition(".")[2]
            tangential = what in ("p1", "p2") and self.tangential
            if what in HELD_BY_DEFAULT and name not in freed and not tangential:
                held[name] = 0.0
        held |= by_full_name(self.pinned, names)
        for name, value in held.items():
            if value is None and name.rpartition(".")[2] not in _NOMINAL:
                raise ValueError(f"`{name}` has no nominal value: fix it as {name}=VALUE")
        return held


def lens_word(lens: str | Mapping[str, str]) -> str:
    """Return the lens of cameras as `CameraOptions.from_text` reads it."""
    kinds = {lens} if isinstance(lens, str) else set(lens.values())
    if isinstance(lens, str) or len(kinds) == 1:
        return kinds.pop()
    return ",".join(f"{camera}={kind}" for camera, kind in lens.items())


def _lens_of(text: str) -> str | dict[str, str]:
    """Read a lens, or NAME=LENS of each camera with commas between."""
    if "=" not in text:
        return text
    found: dict[str, str] = {}
    for word in text.split(","):
        camera, equals, lens = (part.strip() for part in word.partition("="))
        if not equals or not camera:
            raise ValueError(
                f"--lens {text}: give a lens, or NAME=LENS of each camera: left={FISHEYE}"
            )
        if camera in found:
            raise ValueError(f"--lens {text}: camera {camera!r} is named twice")
        found[camera] = lens
    return found


def by_full_name(chosen: Mapping[str, T], names: tuple[str, ...]) -> dict[str, T]:
    """Write out names without a camera; `k3` becomes `left.k3` and `right.k3`.

    Args:
        chosen: Something for each name, with or without its camera.
        names: All camera parameters of the problem.

    Raises:
        ValueError: If a name does not exist; the message suggests and lists those there are.
    """
    found: dict[str, T] = {}
    inside = dict.fromkeys(name.partition(".")[2] for name in names)
    for word, value in chosen.items():
        refuse_unknown("camera parameter", word, (*names, *inside))
        matching = [n for n in names if word in (n, n.partition(".")[2])]
        found |= dict.fromkeys(matching, value)
    return found
