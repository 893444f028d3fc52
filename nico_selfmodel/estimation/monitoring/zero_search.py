"""Where the zeros of encoders may be when they are not near the old ones.

Readings that lost a turn are off by whole turns, others by anything. Far from the right zeros no
slope leads there, so zeros all over the turn are held against the observations at once.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_observations import HandObservations
from nico_selfmodel.estimation.observations.hand_rows import HandPixels
from nico_selfmodel.model.self_model import SelfModel

_ANYWHERE = 8192
"""Zeros tried beside those that lost whole turns."""
_LIKELIEST = 8
"""How many are worth refining."""
_ROWS = 12
"""Observations that they are held against."""
_CLOSE = 0.1
"""Errors count as close below this share of the typical one."""


def likely_offsets(
    model: SelfModel, observations: HandObservations, joints: tuple[str, ...]
) -> NDArray:
    """Return zeros that explain observations better than others all over the turn do.

    Args:
        model: The body; its own zeros are near the truth for all but `joints`.
        joints: Joints whose zeros are lost.

    Returns:
        Encoder angles at q = 0, the likeliest first [rad]. Shape (K, n).
    """
    offsets = _trials(model, np.isin(model.joints, joints))
    errors = _errors(model, observations, offsets)
    # Cauchy: a few observations that fit say more than many that nearly do.
    close = _CLOSE * float(np.median(errors))
    scores = np.sum(np.log1p((errors / close) ** 2), axis=1)
    return offsets[np.argsort(scores, kind="stable")[:_LIKELIEST]]


def _trials(model: SelfModel, lost: NDArray) -> NDArray:
    """Return zeros off by turns of the encoder, then by anything within a turn of the joint."""
    turns = np.array(list(product((-1.0, 0.0, 1.0), repeat=int(lost.sum()))))
    rng = np.random.default_rng(0)
    anywhere = rng.uniform(-0.5, 0.5, (_ANYWHERE, turns.shape[1])) * model.servos.gear[lost]
    offsets = np.tile(model.servos.offset, (len(turns) + len(anywhere), 1))
    offsets[:, lost] += 2.0 * np.pi * np.vstack([turns, anywhere])
    return offsets


def _errors(model: SelfModel, observations: HandObservations, offsets: NDArray) -> NDArray:
    """Return by how much each row is missed with each of K zeros [px or m]. Shape (K, rows)."""
    block = observations.block
    by_sight = isinstance(block, HandPixels)
    arm = block.rows
    rows = np.unique(np.linspace(0, len(observations) - 1, _ROWS).astype(int))
    q = (arm.angles[rows] - offsets[:, None]) / model.servos.gear
    marker = np.tile(arm.marker[rows], len(offsets))
    seen = model.points(q.reshape(-1, q.shape[2]), marker)
    if by_sight:
        seen = model.rig.project(seen)
    misses = seen.reshape(len(offsets), len(rows), -1) - block.measured.T[rows]
    errors = np.sqrt(np.sum(np.where(block.seen[rows], misses, 0.0) ** 2, axis=2))
    worst = float(np.nanmax(errors, initial=1e-9))
    return np.where(np.isfinite(errors), errors, worst)  # behind a camera
