"""Where the arm stands that a robot sees in a mirror, whatever its encoders say."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.mirrors.body_alignment import BodyMotion, alignment_step
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.sessions.mirrors.known_body import AREA, KnownBody, Shot, aligned_view
from nico_selfmodel.systems.rendering.body_image import BodyImage

LOOSE = np.radians(0.7)
"""By what each joint may stand beside its encoder: joints of robots before mirrors are loose by
0.6 deg, and slip by 1.2 deg once in eight postures [rad]."""
_HELD = 1e-5
"""What mirrors may be off by meanwhile: they are known, and the arm is asked for [rad, m]."""
_STEPS, _STILL = 5, 1e-3
"""Of the search at most, and by what no joint turns any more in the last of them [rad]."""


@dataclass(frozen=True, eq=False)
class SeenArm:
    """An arm as two pictures of one look show it."""

    q: NDArray
    """Angles of its joints [rad]. Shape (n,)."""
    covariance: NDArray
    """Of these. Shape (n, n)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        object.__setattr__(self, "q", read_only(self.q))
        object.__setattr__(self, "covariance", read_only(self.covariance))


def see_arm(image: BodyImage, known: KnownBody, shot: Shot) -> SeenArm | None:
    """Tell from a look into a mirror how the arm's joints stand.

    Encoders say where joints are but for what is loose about them; all edges of the arm in the
    mirror, in both pictures, say the rest (`estimation.mirrors.body_alignment`). Its edges with the
    room do not count, for nobody knows what is behind them.

    Args:
        image: What the robot expects; it stands as is known.
        known: How the body stands, and the mirrors.
        shot: What both cameras saw in one of them, and the encoders' readings.

    Returns:
        None where the pictures hardly show the arm.
    """
    servos, mirrors = known.model.servos, [known.model.mirrors[name] for name in known.mirrors]
    start = servos.to_joint(shot.readings[None])[0]
    n, q, covariance = 3 * len(mirrors), start, np.zeros((len(start), len(start)))
    prior = np.diag([*(_HELD**2,) * n, *(LOOSE**2,) * len(q)])
    for _ in range(_STEPS):
        now = replace(shot, readings=servos.to_encoder(q[None])[0])
        image.expect(now.readings, known.model.mirrors[shot.mirror], 0)  # the arm stands so now
        joints = image.standing(image.joints)
        motions = [(BodyMotion(joint.axis, joint.p_WJ), joint.links) for joint in joints]
        views = [
            aligned_view(known, image, now, side, motions, arm=True) for side in range(len(SIDES))
        ]
        before = np.concatenate([np.zeros(n), q - start]), prior
        ways = [motion for motion, _ in motions]
        try:
            found = alignment_step(views, known.model.rig, mirrors, ways, before, AREA)
        except EstimationError:
            return None
        q, covariance = q + found.change[n:], found.covariance[n:, n:]
        if np.abs(found.change[n:]).max() < _STILL:
            break
    return SeenArm(q, covariance)
