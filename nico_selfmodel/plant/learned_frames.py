"""A learned chain laid over a robot's links: where both frames of every joint go.

The links keep their place in the nominal Denavit-Hartenberg frames: X_{DH_i, L_i} is that of the
description. Learned rows then carry the links with them, and
`X_PF = X_{P, DH_i-1} Tz(D) Rz(theta_zero)`, `X_CM = X_{C, DH_i} (Tx(r) Rx(alpha) Ry(beta))^-1`,
with z as the joint's axis.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable

if TYPE_CHECKING:
    from nico_selfmodel.plant.description import ArmDescription

SAME_ZEROS = np.radians(10.0)
"""Most by which zeros of a robot's joints are built beside those of its description. Of a
self-model that has zeros of its own one is further off."""
ON_THE_AXIS = 1e-3
"""A tracked point nearer to the last axis than this [m] says nothing of the last link's turn."""


@dataclass(frozen=True, eq=False)
class LearnedFrames:
    """Poses that turn a robot's description into a learned arm."""

    X_WR: NDArray
    """Pose of the root link in the measuring frame, the joints below the chain at zero or held.
    Shape (4, 4)."""
    X_PF: NDArray
    """Joint frames on the parent links, z along the axes. Shape (n, 4, 4)."""
    X_CM: NDArray
    """Joint frames on the child links, z along the axes. Shape (n, 4, 4)."""
    markers: tuple[str, ...]
    """Names of the tracked points. Length m."""
    X_TH: NDArray
    """Frames of the tracked points on the tip link. Shape (m, 4, 4)."""
    X_WF: NDArray
    """Joint frames on the parent links in the measuring frame, all learned joints at q = 0.
    Shape (n, 4, 4)."""
    zeros: NDArray
    """What is added to the model's joint angles to have the description's in the same posture, to
    within a turn: zero where its zeros are the robot's, `SAME_ZEROS` [rad]. Shape (n,)."""

    def given_way(self, X_WN: NDArray, bearings: NDArray) -> "LearnedFrames":
        """Return the frames where bearings have given way: each on its parent link.

        Args:
            X_WN: Frames before the arm's rows at q = 0. Shape (n, 4, 4).
            bearings: What moves each row in them, `LoadedPosture.bearings`. Shape (n, 4, 4).
        """
        X_FN = inverse(self.X_WF) @ X_WN
        return replace(self, X_PF=self.X_PF @ X_FN @ bearings @ inverse(X_FN))


def learned_frames(arm: "ArmDescription", chain: Chain) -> LearnedFrames:
    """Lay a chain over the links of a robot.

    Nothing measured says where the links are along and around their joints' axes; they stay where
    the description has them against the common normals, and the base link against the first row.
    A marker that the description does not know takes the place of its first one.

    Args:
        chain: The learned arm in the measuring frame, with the same joints.

    Returns:
        Frames with which the robot's forward kinematics is that of `chain`, to rounding.

    Raises:
        ModelError: If the joints differ.
    """
    arm.check_joints(chain.joints)
    nominal, learned = _comparable_tables(arm.chain, chain)
    n, links = len(chain.joints), arm.links
    X_BD = nominal.frames(np.zeros(n))
    # A point on the last axis leaves x_n to chance: turn the last frame back to the nominal one.
    turn = np.zeros(n)
    if abs(nominal.r[-1]) < ON_THE_AXIS:
        turn[-1] = learned.theta_zero[-1] - nominal.theta_zero[-1]
    X_DF = learned.joint_motions(learned.theta_zero - turn)
    spin = transform(rotation_about(np.array([0.0, 0.0, 1.0]), turn), np.zeros(3))
    X_MD = spin @ learned.links @ inverse(spin)
    X_TN = inverse(links.X_BT) @ X_BD[-1] @ spin[-1]
    return LearnedFrames(
        learned.X_W0 @ inverse(X_BD[0]) @ links.X_BR,
        inverse(links.X_BP) @ X_BD[:-1] @ X_DF,
        inverse(links.X_BC) @ X_BD[1:] @ inverse(X_MD),
        learned.markers,
        transform(_hand_rotations(arm, learned.markers), apply(X_TN, learned.p_NH)),
        learned.frames(np.zeros(n))[:-1] @ X_DF,
        _zeros_apart(learned.theta_zero - turn - nominal.theta_zero),
    )


def _zeros_apart(apart: NDArray) -> NDArray:
    """Return by how much zeros differ, to within a turn; nothing where all are about the same."""
    apart = np.remainder(apart + np.pi, 2.0 * np.pi) - np.pi
    return np.where(np.abs(apart).max() > SAME_ZEROS, apart, 0.0)


def _comparable_tables(nominal: Chain, learned: Chain) -> tuple[DhTable, DhTable]:
    """Write two versions of one arm as tables with the same last point, kinds of rows and signs.

    The point that both have (else the first of each) is the origin of the last frame.
    """
    first_nominal, first_learned = _shared_point(nominal, learned)
    table = DhTable.from_chain(_with_first(nominal, first_nominal))
    return table, DhTable.from_chain(_with_first(learned, first_learned), like=table)


def nominal_frames(arm: "ArmDescription", learned: Chain) -> LearnedFrames:
    """Return what `learned_frames` makes of the description itself, to compare with `learned`."""
    return learned_frames(arm, _with_first(arm.chain, _shared_point(arm.chain, learned)[0]))


def _shared_point(nominal: Chain, learned: Chain) -> tuple[str, str]:
    """Return the first point that both have, else the first of each."""
    shared = [marker for marker in learned.markers if marker in nominal.markers]
    return (shared[0], shared[0]) if shared else (nominal.markers[0], learned.markers[0])


def _with_first(chain: Chain, marker: str) -> Chain:
    order = [marker, *(other for other in chain.markers if other != marker)]
    rows = [chain.marker_index(name) for name in order]
    return replace(chain, markers=tuple(order), p_WH_zero=chain.p_WH_zero[rows])


def _hand_rotations(arm: "ArmDescription", markers: tuple[str, ...]) -> NDArray:
    """Return the nominal orientations of the markers' frames in the tip link. Shape (m, 3, 3)."""
    nominal = dict(zip(arm.markers, inverse(arm.links.X_BT) @ arm.links.X_BH, strict=True))
    return np.stack([nominal.get(marker, np.eye(4))[:3, :3] for marker in markers])
