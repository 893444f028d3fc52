"""What a refinement of the whole body frees, what it is anchored to, and how it weighs."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from nico_selfmodel.estimation.cameras.camera_options import HELD_BY_DEFAULT, by_full_name
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.model.cameras.projection import EVERY_INTRINSIC, RATIONAL
from nico_selfmodel.model.cameras.rig_parameters import SIDES, rig_names
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.names import refuse_unknown

STAGES = ("kinematics", "intrinsics-fixed", "full")
"""The thesis' three: the arm before pinned cameras; the right camera's pose too; lenses too."""
VARIANTS = ("anchored", "unanchored", "thesis")
"""`anchored`: chessboard corners in the same problem. `unanchored`: without them. `thesis`: as
published, without boards, lens distortion or whitening."""
LOSSES = ("trimmed", "none")
"""Least squares without what nothing explains, or over all."""
_LENS = ("k1", "k2", "k3")


@dataclass(frozen=True)
class BodyOptions:
    """How arm and cameras refine each other."""

    stage: str = "full"
    """One of `STAGES`."""
    variant: str = "anchored"
    """One of `VARIANTS`; stage `kinematics` is the same in all but for the whitening."""
    pins: FixedParameters = field(default_factory=FixedParameters)
    """What is held and what moves, beyond what does by default."""
    loss: str = "trimmed"
    """Of poses, one of `LOSSES`."""

    def __post_init__(self) -> None:
        """Check the choices."""
        refuse_unknown("stage", self.stage, STAGES)
        refuse_unknown("variant", self.variant, VARIANTS)
        refuse_unknown("loss", self.loss, LOSSES)

    @property
    def anchored(self) -> bool:
        """Whether chessboard corners take part."""
        return self.variant == "anchored" and self.stage != "kinematics"

    @property
    def whitened(self) -> bool:
        """Whether pixels are weighed by tracker noise and joint noise."""
        return self.variant != "thesis"

    def at(self, stage: str) -> "BodyOptions":
        """Return the same choices for another stage."""
        return replace(self, stage=stage)

    def held_cameras(self, rig: StereoRig) -> dict[str, float | None]:
        """Return the parameters of the cameras that stay, None where they stay as they are.

        Raises:
            ValueError: If an option names no parameter of the cameras.
        """
        names = rig.names
        pinned = by_full_name(self._of_cameras(self.pins.pinned), names)
        freed = set(by_full_name(self._of_cameras(dict.fromkeys(self.pins.freed)), names))
        held: dict[str, float | None] = dict.fromkeys(names)
        if self.stage != "kinematics":
            fixed = set(HELD_BY_DEFAULT)
            rational = {s for s, c in zip(SIDES, rig.cameras, strict=True) if c.lens == RATIONAL}
            # Boards alone hardly tell what is below the fraction.
            below = {f"{side}.{k}" for side in rational for k in ("k4", "k5", "k6")}
            if self.variant == "thesis":
                fixed |= set(_LENS)
            if self.stage == "intrinsics-fixed":
                fixed |= set(EVERY_INTRINSIC)
            held = {n: None for n in names if n.rpartition(".")[2] in fixed or n in below}
            if not self.anchored:
                held[self.scale_name(rig)] = None
        return {n: v for n, v in held.items() if n not in freed} | pinned

    @staticmethod
    def scale_name(rig: StereoRig) -> str:
        """Return the component of the baseline that holds the scale where no board does."""
        place = rig.X_LR[:3, 3]
        return f"right.pose.{'xyz'[int(abs(place).argmax())]}"

    @property
    def arm_pins(self) -> FixedParameters:
        """What of it does not belong to the cameras."""
        of_cameras = set(self._of_cameras(dict.fromkeys(self.pins.names)))
        pinned = {n: v for n, v in self.pins.pinned.items() if n not in of_cameras}
        return FixedParameters(pinned, self.pins.freed - of_cameras)

    @staticmethod
    def _of_cameras(words: Mapping[str, float | None]) -> dict[str, float | None]:
        """Return what speaks of cameras: `left.cx`, `cx`, `right.pose.x`."""
        bare = {n.partition(".")[2] for n in rig_names(SIDES, RATIONAL)}
        return {
            word: value
            for word, value in words.items()
            if word in bare or word.partition(".")[0] in SIDES
        }
