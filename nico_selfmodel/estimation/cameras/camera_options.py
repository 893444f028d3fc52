"""Which camera parameters are held, freed or given a prior."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.model.cameras.projection import FISHEYE, LENSES, POLYNOMIAL
from nico_selfmodel.model.cameras.rig_parameters import each_lens, rig_names
from nico_selfmodel.names import did_you_mean, listed
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
        if self.loss not in ROBUST_METHODS:
            raise ValueError(f"no loss {self.loss!r}; there are {', '.join(ROBUST_METHODS)}")
        if isinstance(self.lens, str) and self.lens not in (AUTO, *LENSES):
            raise ValueError(f"no lens {self.lens!r}; there are {AUTO}, {', '.join(LENSES)}")
        for camera, lens in {} if isinstance(self.lens, str) else self.lens.items():
            if lens not in LENSES:
                raise ValueError(f"no lens {lens!r} of {camera!r}; there are {', '.join(LENSES)}")
        if self.aspect is not None and not self.aspect > 0.0:
            raise ValueError(f"aspect must be positive, got {self.aspect}")

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
            ValueError: If a value is not a number, or a name is both pinned and freed.
        """
        pinned = {}
        for word in pin:
            name, equals, value = word.partition("=")
            pinned[name.strip()] = number_of_word(value, f"--fix {word}") if equals else None
        priors = {}
        for word in prior:
            name, _, value = word.partition("=")
            mean, comma, sigma = value.partition(",")
            if not comma:
                raise ValueError(f"--prior {word}: give NAME=MEAN,SIGMA")
            priors[name.strip()] = tuple(
                number_of_word(v, f"--prior {word}") for v in (mean, sigma)
            )
            if not priors[name.strip()][1] > 0.0:
                raise ValueError(f"--prior {word}: sigma must be positive")
        both = set(pinned) & set(free)
        if both:
            raise ValueError(f"{', '.join(sorted(both))} cannot be both pinned and freed")
        kind = _lens_of(lens)
        return cls(pinned=pinned, freed=frozenset(free), priors=priors, lens=kind, **others)  # type: ignore[arg-type]

    def lenses(self, cameras: Sequence[str]) -> tuple[str, ...]:
        """Return the lens of each of some cameras.

        Raises:
            ValueError: If lenses are given by name, and not of just these cameras.
        """
        if isinstance(self.lens, str):
            return each_lens(self.lens, len(cameras))
        unknown = [name for name in self.lens if name not in cameras]
        if unknown:
            hint = did_you_mean(unknown[0], cameras) or "."
            raise ValueError(
                f"a lens is given of {unknown[0]!r}{hint} There are: {listed(cameras)}"
            )
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
                raise ValueError(f"`{name}` has no nominal value: pin it as {name}=VALUE")
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
    for word, value in chosen.items():
        matching = [n for n in names if word in (n, n.partition(".")[2])]
        if not matching:
            raise ValueError(f"no camera parameter {word!r}{_hint(word, names)}")
        found |= dict.fromkeys(matching, value)
    return found


def _hint(word: str, names: Iterable[str]) -> str:
    names = list(names)
    meant = did_you_mean(word, [*names, *(n.partition(".")[2] for n in names)]) or "."
    return f"{meant} There are: {listed(names)}"
