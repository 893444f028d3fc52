"""What is wrong with a simulated body and its tracker: the documented worlds."""

from dataclasses import dataclass, replace

import numpy as np

from nico_selfmodel.names import refuse_unknown


@dataclass(frozen=True)
class Imperfections:
    """Imperfections of a simulated arm under motion capture.

    Angles in radians, lengths in metres. Play is uniform in +-play, everything else Gaussian.
    """

    name: str
    """What the world is called."""
    link_sigma: float = 2e-3
    """How far axes and hand points lie from the robot's description [m]."""
    axis_sigma: float = np.radians(1.5)
    """How far axes are tilted from the robot's description [rad]."""
    gear_sigma: float = 0.01
    """Relative deviation of the gears from their nominal ratios."""
    extra_gear: float = 1.6
    """Ratio of the last joint's further reduction; the others have 1."""
    encoder_zero: float = 1.0
    """Zeros lie anywhere within +- this encoder angle: they are lost at power-off [rad]."""
    stop_spread: float = np.radians(1.0)
    """How far inside the description's limits the stops may lie [rad]."""
    counts_per_turn: int = 16384
    """Encoder counts a turn of the geared encoder."""
    play: float = 0.0
    """Half the width of the joint noise between encoder and link [rad]."""
    backlash: float = 0.0
    """Half width of the gap between drive and link, which every change of direction crosses
    [rad]."""
    sag: float = 0.0
    """Deflection of the joint that carries the largest gravity torque [rad]."""
    wobble: float = 0.0
    """Standard deviation of the shoulder joints' rare looseness [rad]."""
    wobble_share: float = 0.0
    """Share of poses in which the shoulder is loose."""
    marker_sigma: float = 0.0
    """Noise of each measured coordinate [m]."""
    dropout_share: float = 0.0
    """Share of measurements in which the tracker loses a marker."""
    paint_sigma: float = 0.0
    """What the colours of its paints differ by from the robot's description, as a share."""
    papered: bool = False
    """Whether papered walls stand behind and beside the robot, which it sees in mirrors."""

    def origin(self, robot: str, seed: int, session: int) -> str:
        """Return what a data set of such a robot says of where it comes from."""
        return f"{robot}, imperfections {self.name!r}, robot {seed}, session {session}"

    def with_noise(
        self,
        *,
        play_deg: float | None = None,
        backlash_deg: float | None = None,
        marker_mm: float | None = None,
    ) -> "Imperfections":
        """Return the world with other play or backlash [deg], or marker noise [mm]."""
        changed = self
        if play_deg is not None:
            changed = replace(changed, play=float(np.radians(play_deg)))
        if backlash_deg is not None:
            changed = replace(changed, backlash=float(np.radians(backlash_deg)))
        if marker_mm is not None:
            changed = replace(changed, marker_sigma=1e-3 * marker_mm)
        return changed if changed == self else replace(changed, name=f"{self.name}, changed")


IMPERFECTIONS = {
    # Geometry, zeros and gears to be learned, nothing else: what is learned must be exact to the
    # encoders' resolution.
    "clean": Imperfections("clean", counts_per_turn=2**24),
    # Tuned to the means of the thesis' chapter 6; its marker balls measure 14 mm.
    "thesis": Imperfections(
        "thesis",
        play=np.radians(0.6),
        sag=np.radians(0.8),
        wobble=np.radians(1.2),
        wobble_share=0.12,
        marker_sigma=6e-4,
        dropout_share=0.02,
    ),
}


def imperfections_named(name: "str | Imperfections") -> Imperfections:
    """Return a documented world, or the one that is given in place of a name.

    Raises:
        ValueError: If there is none of that name; the message lists those there are.
    """
    if isinstance(name, Imperfections):
        return name
    refuse_unknown("imperfections", name, IMPERFECTIONS)
    return IMPERFECTIONS[name]
