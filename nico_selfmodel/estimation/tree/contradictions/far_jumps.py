"""Where joints may have been that were read wrongly by far more than is linear.

A joint that is off by 20 deg puts all that it carries where no derivative at its reading leads.
What it carries is nearly all set aside then: all angles of each such joint are tried in such a
visit, and the one after which most of it fits is a place to be linear about. Whether the joint
slipped there is asked as of any other (see `hidden_slips`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ObservationTable
from nico_selfmodel.estimation.diagnosis.misread_joint import TRIED_TURNS
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.model.tree.body_tree import REVOLUTE

_ASIDE = 0.8
"""Share of what a joint moves in a visit that must be set aside for it to have jumped."""
_MOST = 0.35
"""Share of all visits in which something is set aside so from which on it is no accident."""


def with_far_jumps(
    residuals: TreeResiduals,
    values: NDArray,
    outliers: NDArray,
    by_joint: NDArray,
    scale: NDArray,
    errors: NDArray,
) -> NDArray:
    """Return joint errors in which joints have jumped where that explains what was set aside.

    Args:
        residuals: The forward model.
        values: Of all parameters. Shape (P,).
        outliers: By row of the table. Boolean, shape (N,).
        by_joint: Derivatives by joint errors. Shape (R, m).
        scale: Standard deviation of each scalar's sensor. Shape (R,).
        errors: Joint errors as they are expected to be. Shape (samples, m).

    Returns:
        Shape (samples, m).
    """
    seen = residuals.observations
    visit, joint = _asked(seen, outliers, by_joint)
    if not len(visit):
        return errors
    jump = np.zeros(len(visit))
    cost = jump
    for grid in TRIED_TURNS:
        tried = jump[:, None] + grid
        costs = _costs(residuals, values, scale, visit, joint, tried)
        best = np.argmin(costs, axis=1)
        jump, cost = (np.take_along_axis(a, best[:, None], 1)[:, 0] for a in (tried, costs))
    out = errors.copy()
    for v in np.unique(visit).tolist():
        own = np.flatnonzero(visit == v)
        k = own[np.argmin(cost[own])]
        out[seen.data.visit == v, joint[k]] = jump[k]
    return out


def _asked(seen: TreeObservations, outliers: NDArray, by_joint: NDArray) -> tuple[NDArray, NDArray]:
    """Return visits and joints that may have jumped in them. Shapes (k,)."""
    joints = [seen.data.joints[i].motion == REVOLUTE for i, _ in seen.noisy_joints]
    may = np.array(joints, dtype=bool) & ~seen.unread
    counts = int(seen.data.visit.max(initial=-1)) + 1
    mine = ~seen.apart & (seen.visit < counts)
    moved = (by_joint != 0.0) & mine[:, None]
    out = moved & outliers[seen.row][:, None]
    of, aside = np.zeros((counts, len(may))), np.zeros((counts, len(may)))
    np.add.at(of, seen.visit[mine], moved[mine])
    np.add.at(aside, seen.visit[mine], out[mine])
    # One number is explained by any joint, turned by something.
    asked = (aside > 0.0) & (aside >= _ASIDE * of) & (of > 1.0) & may
    if asked.any(axis=1).mean() > _MOST:
        asked[:] = False
    visit, joint = np.nonzero(asked)
    return visit, joint


def _costs(
    residuals: TreeResiduals,
    values: NDArray,
    scale: NDArray,
    visit: NDArray,
    joint: NDArray,
    tried: NDArray,
) -> NDArray:
    """Return what visits leave with a joint turned by some angles, sum log(1 + r^2). (k, g)."""
    seen = residuals.observations
    data, table = seen.data, seen.data.observations
    gear, grid = residuals.parameters.tree_of(values).gear, tried.shape[1]
    row_visit = np.append(data.visit, -1)[table.pose]
    samples, poses, rows, which = [], [], [], []
    readings = []
    for n, (v, j) in enumerate(zip(visit.tolist(), joint.tolist(), strict=True)):
        i = seen.noisy_joints[j][0]
        own, some = np.flatnonzero(data.visit == v), np.flatnonzero(row_visit == v)
        moved = np.tile(data.readings[own], (grid, 1))
        off = np.repeat(tried[n], len(own)) * gear[i] / data.joints[i].si_per_unit
        moved[:, i] += off
        first = sum(map(len, samples))
        at = first + np.searchsorted(own, table.pose[some])
        readings.append(moved)
        samples.append(np.tile(own, grid))
        poses.append((at + len(own) * np.arange(grid)[:, None]).ravel())
        rows.append(np.tile(some, grid))
        which.append(n * grid + np.repeat(np.arange(grid), len(some)))
    sample, row = np.concatenate(samples), np.concatenate(rows)
    few = table.select(row)
    moved_data = replace(
        data,
        sample=np.arange(len(sample)),
        readings=np.concatenate(readings),
        flanges=np.asarray(data.flanges)[sample],
        approach=np.asarray(data.approach)[sample],
        observations=ObservationTable(
            np.concatenate(poses), few.sensor, few.marker, few.other, few.values, few.mirror
        ),
    )
    again = TreeObservations.of(moved_data)
    r = TreeResiduals(again, residuals.parameters).residuals(values)
    sigma = np.zeros(len(table))
    sigma[seen.row] = scale
    left = np.log1p((r / sigma[row[again.row]]) ** 2)
    of = np.concatenate(which)[again.row]
    return np.bincount(of, left, minlength=tried.size).reshape(tried.shape)
