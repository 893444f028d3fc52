"""Postures to look at oneself in: the own arm covers little of the rest of the body."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks

_CANDIDATES = 16
"""Postures that are drawn, free of collisions."""
_TRIES = 40
"""Postures tried for each of them."""
_SHARE = 0.9
"""What a posture must leave to be judged, of what the best of them leaves."""
CLEARANCE = 0.05
"""How far the arm's links keep from the glass [m]."""


def look_poses(
    looks: MirrorLooks, workspace: VisibleWorkspace, rng: np.random.Generator
) -> NDArray:
    """Draw postures from which both cameras can judge most of the body in the mirror.

    A hand that is held up to be seen in the mirror covers, with what is about it, half of head and
    chest; it takes an arm held aside to look at these. How much a posture leaves is counted in the
    picture that is expected there, in the camera that can judge less.

    Args:
        looks: The robot before a mirror that it knows.

    Returns:
        Where to go, those that leave nine tenths of what the best leaves, best first [encoder
        units]. Shape (K, n).

    Raises:
        EstimationError: If both cameras can judge nothing in any of them.
    """
    commands = _free(looks, workspace, rng)
    left = np.array([min(map(np.count_nonzero, looks.judged_at(one))) for one in commands])
    if not left.any():
        raise EstimationError(
            f"of {len(commands)} postures none leaves anything of the body to be judged in the "
            "mirror: put it before the robot's face"
        )
    order = np.argsort(-left, kind="stable")
    return commands[order[left[order] >= _SHARE * left.max()]]


def _free(looks: MirrorLooks, workspace: VisibleWorkspace, rng: np.random.Generator) -> NDArray:
    """Draw postures in which the arm touches neither the body nor the glass. Shape (k, n)."""
    arm, found = workspace.arm, np.zeros((0, len(workspace.arm.joints)))
    for _ in range(_TRIES * _CANDIDATES):
        q = rng.uniform(arm.lower, arm.upper)
        if workspace.body.collides(q):
            continue
        command = commands_of_angles(looks.body.joints, arm.lower, arm.upper, q[None])
        if looks.clearance(command[0]) > CLEARANCE:
            found = np.concatenate([found, command])
        if len(found) == _CANDIDATES:
            break
    return found
