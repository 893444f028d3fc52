"""Where the arm stands that a robot sees in a mirror, whatever its encoders say."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.mirrors.body_alignment import (
    AlignedView,
    BodyMotion,
    alignment_step,
)
from nico_selfmodel.estimation.mirrors.reflection_sigma import LooseParts
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.sessions.looks.card import card_of
from nico_selfmodel.sessions.looks.known_body import AREA, KnownBody, Shot, aligned_view
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.images.body_in_room import within_hulls

LOOSE = np.radians(0.7)
"""By what each joint may stand beside its encoder: joints of robots before mirrors are loose by
0.6 deg, and slip by 1.2 deg once in eight postures [rad]."""
_HELD = 1e-5
"""What mirrors may be off by meanwhile: they are known, and the arm is asked for [rad, m]."""
SHOULDER = 5e-4
"""What the whole arm may stand beside where it was learned, each coordinate: where two joints turn
about nearly the same line they would go far to explain it [m]."""
_COARSE, _FINE = 3.0, 1.0
"""What pictures are smoothed by in a step of the search, coarse ones first, for a hand may be seen
ten pixels from where encoders have it [px]."""
_NEAR, _STILL = np.radians(0.5), 2e-3
"""By what the joint that turns most does in a step after which pictures are fine, and after which
the search ends [rad]."""
_STEPS = 16
"""In which it ends, or never: of a slip of 3 deg the first four find 2.2."""
EDGE = 8.0
"""Change from pixel to pixel that counts as an edge: shades of a round limb hardly tell how it is
turned about itself, and took joints 3 deg away [grey levels]."""
_SELDOM = 1e-3
"""How seldom joints stand farther from their encoders than where they may be seen."""
MARKER = 0.02
"""How far from where a marker is mounted what is attached there may be [m]."""


@dataclass(frozen=True, eq=False)
class SeenArm:
    """An arm as two pictures of one look show it."""

    q: NDArray
    """Angles of its joints [rad]. Shape (n,)."""
    covariance: NDArray
    """Of these. Shape (n, n)."""
    readings: NDArray
    """What encoders would read there [encoder units]. Shape (n,)."""
    motions: Sequence[tuple[BodyMotion, frozenset[str]]]
    """How each joint moves what is beyond it, and these links."""
    attached: tuple[NDArray, NDArray]
    """Pixels of the left and the right picture that may show what is attached to the hand, its card
    and other markers, which is not as it is described. Shape (h, w) each."""
    hand: frozenset[str]
    """Links that the last joint moves."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("q", "covariance", "readings"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        left, right = self.attached
        object.__setattr__(self, "attached", (read_only(left), read_only(right)))

    def loose(self, labels: NDArray, numbers: dict[str, int]) -> LooseParts:
        """Return what its joints leave open of a picture.

        Args:
            labels: Number of the link that each pixel shows. Shape (h, w).
            numbers: Of each link.
        """
        moved = [np.isin(labels, [numbers[link] for link in links]) for _, links in self.motions]
        return LooseParts([motion for motion, _ in self.motions], np.array(moved), self.covariance)


def see_arm(image: BodyImage, known: KnownBody, shot: Shot) -> SeenArm | None:
    """Tell from a look into a mirror how the arm's joints stand.

    Encoders say where joints are but for what is loose about them; all edges of the arm in the
    mirror, in both pictures, say the rest (`estimation.mirrors.body_alignment`), those with the
    room as it looks a little way beside them. The hand does not count: what is attached to it is
    not as it is described, and fingers were seen to be farther off with it than without. Nor do
    shades; and all of the arm may stand a little beside where it was learned, which is no matter
    of its joints.

    Args:
        image: What the robot expects; it stands as is known.
        known: How the body stands, and the mirrors.
        shot: What both cameras saw in one of them, and the encoders' readings.

    Returns:
        None where the pictures hardly show the arm, or where joints as loose as these would stand
        once in a thousand times.
    """
    servos, mirrors = known.model.servos, [known.model.mirrors[name] for name in known.mirrors]
    start = servos.to_joint(shot.readings[None])[0]
    n, q, covariance = 3 * len(mirrors), start, np.zeros((len(start), len(start)))
    joints, shift = slice(n, n + len(q)), np.zeros(3)
    prior = np.diag([*(_HELD**2,) * n, *(LOOSE**2,) * len(q), *(SHOULDER**2,) * len(shift)])
    smooth, turned = _COARSE, np.inf
    for _ in range(_STEPS):
        smooth = _FINE if turned < _NEAR else smooth  # and never back: it would go to and fro
        now = _Standing.at(image, known, shot, q)
        views = [now.view(side, smooth) for side in range(len(SIDES))]
        # What the whole arm is shifted by is not drawn: each picture shows all of it.
        before = np.concatenate([np.zeros(n), q - start, shift]), prior
        ways = [motion for motion, _ in now.ways]
        try:
            found = alignment_step(views, known.model.rig, mirrors, ways, before, AREA)
        except EstimationError:
            return None
        turned = float(np.abs(found.change[joints]).max())
        q, covariance = q + found.change[joints], found.covariance[joints, joints]
        if smooth == _FINE and turned < _STILL:
            break
    else:
        return None
    if chi_square_tail(float(np.sum((q - start) ** 2)) / LOOSE**2, len(q)) < _SELDOM:
        return None
    now = _Standing.at(image, known, shot, q)
    left, right = (now.attached(side) for side in range(len(SIDES)))
    return SeenArm(q, covariance, now.shot.readings, now.motions, (left, right), now.hand)


@dataclass(frozen=True, eq=False)
class _Standing:
    """The arm as it may stand, beside what was seen."""

    image: BodyImage
    known: KnownBody
    shot: Shot
    """What was seen, at what encoders would read there."""
    motions: Sequence[tuple[BodyMotion, frozenset[str]]]
    hand: frozenset[str]
    """Links that the last joint moves."""
    poses: Mapping[str, NDArray]
    """Link -> its pose. Shape (4, 4)."""

    @classmethod
    def at(cls, image: BodyImage, known: KnownBody, shot: Shot, q: NDArray) -> "_Standing":
        """Let the arm stand at joint angles."""
        now = replace(shot, readings=known.model.servos.to_encoder(q[None])[0])
        poses = image.poses(now.readings)
        joints = image.standing(image.joints)
        motions = [(BodyMotion(joint.axis, joint.p_WJ), joint.links) for joint in joints]
        return cls(image, known, now, motions, joints[-1].links, poses)

    @property
    def ways(self) -> Sequence[tuple[BodyMotion, frozenset[str]]]:
        """How it may stand elsewhere: its joints, and all of it shifted."""
        arm = self.motions[0][1]
        return [*self.motions, *((BodyMotion(axis, None), arm) for axis in np.eye(3))]

    def view(self, side: int, smooth: float) -> AlignedView:
        """Hold the arm in one picture beside what is expected, but for its hand."""
        view = aligned_view(
            self.known, self.image, self.shot, side, self.ways, arm=True, smooth=smooth
        )
        down, right = np.gradient(view.expected, axis=(0, 1))
        edges = np.hypot(right, down).max(axis=2) > EDGE
        hand = view.moved[len(self.motions) - 1]
        return replace(view, used=view.used & edges & ~(self.attached(side) | hand))

    def attached(self, side: int) -> NDArray:
        """Return which pixels may show what is attached to the hand, or hides it. Shape (h, w)."""
        known, readings = self.known, self.shot.readings
        rig = MirrorRig(known.model.rig, known.mirror(self.shot.mirror))
        shape = self.shot.pictures[side].shape[:2]
        blocks = []
        # The marker was learned where the arm stands in a body that does not stand elsewhere.
        card = card_of(known.model, readings, inverse(known.X_WB) @ self.poses[min(self.hand)])
        if card is not None:
            blocks.append(apply(self.poses[min(self.hand)], card.block))
        ball = MARKER * np.array(list(product((-1.0, 1.0), repeat=3))) / np.sqrt(3.0)
        blocks += [
            self.poses[link][:3, 3] + ball for link in self.hand - self.image.surfaces.keys()
        ]
        own = slice(2 * side, 2 * side + 2)
        return within_hulls([rig.project(block)[:, own] for block in blocks], shape)
