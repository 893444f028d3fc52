"""Which changes a monitor looks for at every pose, and how likely each is beforehand."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.geometry.rotation import rotation_vector_slope, skew
from nico_selfmodel.model.arm.dh_parameters import M0_NAMES
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES
from nico_selfmodel.model.self_model import SelfModel

RIGHT_POSE = tuple(f"right.pose.{name}" for name in POSE_NAMES)
"""Pose of the right camera in the left one's frame: rotation vector, then place."""
JUMPS = np.radians([2.0, 6.0])
"""Encoder jumps of a joint, either way, the likelier size first [rad]."""
SHIFTS = (0.005, 0.015)
"""Distances by which a tracked point may have moved on the hand [m]."""
TURN = np.radians(1.0)
"""By how much a camera may have turned [rad]."""
STRETCH = np.radians(3.0)
"""By how much a joint whose gear changed is off at the ends of the readings it was learned from
[rad]."""
WIDER = np.array([4.0])
"""Anything else makes residuals with so many times the variance of the noise's tail, or larger ones
at every pose."""
ANYTHING = len(WIDER) + 1
"""Number of these."""
WEIGHTS = {"jump": 0.6, "point": 0.2, "camera": 0.2, "gear": 0.1, "anything": 0.2}
"""How likely each kind of change is beforehand, up to a factor."""
RARER = 1.0 / 3.0
"""How likely the larger size of a change is, against the smaller one."""
PLAIN, MUCH_PLAINER = 6.0, 2.0
"""By what a change moves a pose, in standard deviations (rms), that louder noise seldom does (where
it made squares 1.5 times as large, a third of 24 recordings raised an alarm with 4, none with 6),
and how many times as much the sizes above must do, for one that does just that to be looked for as
well."""
LARGEST_STEP = 6.0
"""Most that one pose adds to the logarithm of a likelihood ratio."""


@dataclass(frozen=True, eq=False)
class MonitoredChanges:
    """Changes of a body with their weights: m of named parameters, then those of anything."""

    basis: NDArray
    """The changes, as columns among all parameters. Shape (P, m)."""
    weights: NDArray
    """Sum 1. Shape (m + ANYTHING,)."""

    def __len__(self) -> int:
        """Return how many changes there are."""
        return len(self.weights)

    def with_plain_sizes(self, density: MixtureDensity, slopes: NDArray) -> "MonitoredChanges":
        """Return the same with smaller changes of a robot whose noise hides less.

        A change h moves a pose by |W h| standard deviations, rms over the poses. Where that is
        beyond `MUCH_PLAINER` times `PLAIN`, one of `PLAIN` is as likely as it beforehand.

        Args:
            density: Of the poses, what the model is uncertain by included.
            slopes: Derivatives of the prediction by all parameters. Shape (N, K, P).
        """
        white = density.whiten(slopes @ self.basis)[0]
        moved = np.sqrt(np.mean(np.sum(white**2, axis=1), axis=0))
        smaller = np.flatnonzero(moved > MUCH_PLAINER * PLAIN)
        weights = self.weights.copy()
        weights[smaller] *= 0.5
        more = self.basis[:, smaller] * (PLAIN / moved[smaller])
        named = len(moved)
        order = (weights[:named], weights[smaller], weights[named:])
        return MonitoredChanges(np.hstack([self.basis, more]), np.concatenate(order))

    def steps(self, density: MixtureDensity, residuals: NDArray, slopes: NDArray) -> NDArray:
        """Return what each pose says for each change.

        An outlier looks like any change, so that with their share g and density u

            l = min(6, ln [(1 - g) f(r - h) + g u(r)] - ln [(1 - g) f(r) + g u(r)])

        What lies far from where a change puts it says nothing for it. That all poses from some one
        on are far off, of density u, is a change too, for which each says -ln g at most: no pose
        alone says enough.

        Args:
            density: Of the poses, what the model is uncertain by included.
            residuals: r. Shape (N, K).
            slopes: Derivatives of the prediction by all parameters. Shape (N, K, P).

        Returns:
            Shape (N, len(self)).
        """
        moved = density.log_moved(residuals, slopes @ self.basis)
        other = density.log_tail(residuals, WIDER)
        unchanged = density.log(residuals)[:, None]
        noisy = np.log1p(-density.outlier_share)
        far = density.log_false(residuals)[:, None]
        changed = noisy + np.concatenate([moved, other, far], axis=1)
        false = np.log(max(density.outlier_share, np.finfo(float).tiny)) + far
        ratios = np.logaddexp(changed, false) - np.logaddexp(noisy + unchanged, false)
        return np.minimum(ratios, LARGEST_STEP)


def monitored_changes(model: SelfModel, names: tuple[str, ...]) -> MonitoredChanges:
    """Return what is looked for in a body: encoder jumps, points that moved, turned cameras.

    Args:
        names: Parameters that its measurements depend on.
    """
    kinds = {"jump": _jumps(model, names), "point": _shifts(model, names)}
    gears = _stretches(model, names)
    if len(gears):
        kinds["gear"] = (gears, np.ones(len(gears)))
    if set(RIGHT_POSE) <= set(names):
        cameras = (right_camera(model, names), left_camera(model, names))
        turns = np.concatenate([_turns(camera) for camera in cameras])
        kinds["camera"] = (turns, np.ones(len(turns)))
    columns = np.concatenate([columns for columns, _ in kinds.values()])
    kinds["anything"] = (np.zeros((0, len(names))), np.ones(ANYTHING))
    weights = [WEIGHTS[kind] * own / own.sum() for kind, (_, own) in kinds.items()]
    weights = np.concatenate(weights)
    return MonitoredChanges(columns.T, weights / weights.sum())


def right_camera(model: SelfModel, names: tuple[str, ...]) -> NDArray:
    """Return what a turn and a shift of the right camera do to the parameters. Shape (P, 6)."""
    basis = np.zeros((len(names), 6))
    turns = [names.index(name) for name in RIGHT_POSE[:3]]
    basis[np.ix_(turns, range(3))] = np.linalg.inv(rotation_vector_slope(model.rig.values[20:23]))
    basis[[names.index(name) for name in RIGHT_POSE[3:]], range(3, 6)] = 1.0
    return basis


def left_camera(model: SelfModel, names: tuple[str, ...]) -> NDArray:
    """Return what a turn and a shift of the left camera do to the parameters. Shape (P, 6).

    It is the world: when it turns, arm and right camera seem to move together. x -> x + w x x + t
    moves M0 and the right camera's pose alike, their rotation vectors by the inverse of
    `rotation_vector_slope`.
    """
    basis = np.zeros((len(names), 6))
    parameters, rig = model.parameters, model.rig
    frames = (
        (M0_NAMES[3:], M0_NAMES[:3], parameters.base_turn, model.dh.X_W0[:3, 3]),
        (RIGHT_POSE[:3], RIGHT_POSE[3:], rig.values[20:23], rig.X_LR[:3, 3]),
    )
    for turns, places, vector, place in frames:
        rows = [names.index(name) for name in turns]
        basis[np.ix_(rows, range(3))] = np.linalg.inv(rotation_vector_slope(vector))
        rows = [names.index(name) for name in places]
        basis[np.ix_(rows, range(3))] = -skew(place)
        basis[np.ix_(rows, range(3, 6))] = np.eye(3)
    return basis


def _jumps(model: SelfModel, names: tuple[str, ...]) -> tuple[NDArray, NDArray]:
    """Return encoder jumps as rows, shape (4 n, P), and their weights."""
    rows, weights = [], []
    for (i, joint), size, sign in product(enumerate(model.joints), JUMPS, (1.0, -1.0)):
        row = np.zeros(len(names))
        row[names.index(f"{joint}.theta_offset")] = sign * size * model.servos.gear[i]
        rows.append(row)
        weights.append(1.0 if size == JUMPS[0] else RARER)
    return np.array(rows), np.array(weights)


def _shifts(model: SelfModel, names: tuple[str, ...]) -> tuple[NDArray, NDArray]:
    """Return shifts of each tracked point, and of all together, as rows and their weights."""
    grid = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
    # The faces and the corners of a cube.
    ways = grid[np.isin(np.abs(grid).sum(axis=1), (1.0, 3.0))]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    groups: list[tuple[str, ...]] = [(marker,) for marker in model.markers]
    if len(groups) > 1:
        groups.append(model.markers)
    rows, weights = [], []
    for group, size in product(groups, SHIFTS):
        block = np.zeros((len(ways), len(names)))
        for marker in group:
            own = [names.index(f"hand.{marker}.{axis}") for axis in "xyz"]
            block[:, own] = size * ways
        rows.append(block)
        weights.append(np.full(len(ways), 1.0 if size == SHIFTS[0] else RARER))
    return np.concatenate(rows), np.concatenate(weights)


def _stretches(model: SelfModel, names: tuple[str, ...]) -> NDArray:
    """Return changes of gears about the middle of the readings learned from, as rows. (2 n, P).

    With e = theta_offset + gear theta, a gear that grows by a share s about e_mid has
    d(gear) = s gear, d(theta_offset) = -s (e_mid - theta_offset).
    """
    known, servos, rows = model.fit.get("readings", {}), model.servos, []
    offset = dict(zip(model.parameters.names, model.parameters.values.tolist(), strict=True))
    if not set(model.joints) <= set(known):
        return np.zeros((0, len(names)))
    ends = servos.to_radians(np.array([known[joint] for joint in model.joints]).T)
    for i, joint in enumerate(model.joints):
        reach = abs(ends[1, i] - ends[0, i]) / (2.0 * servos.gear[i])
        if reach > STRETCH:
            row, own = np.zeros(len(names)), f"{joint}.theta_offset"
            row[names.index(f"{joint}.gear")] = servos.gear[i] * STRETCH / reach
            middle = 0.5 * (ends[0, i] + ends[1, i]) - offset[own]
            row[names.index(own)] = -middle * STRETCH / reach
            rows += [row, -row]
    return np.array(rows).reshape(-1, len(names))


def _turns(camera: NDArray) -> NDArray:
    """Return turns of a camera about its three axes, either way, as rows. Shape (6, P)."""
    return TURN * np.concatenate([camera[:, :3].T, -camera[:, :3].T])
