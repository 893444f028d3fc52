"""A sensor that contradicts all the others: without it the recording fits, or it lies behind."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, DISTANCE, POINTS, SIGHTS
from nico_selfmodel.errors import DataError, SelfModelError
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_NOISE
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart
from nico_selfmodel.estimation.tree.timing.late_sensors import explained_by_lag
from nico_selfmodel.estimation.tree.timing.parted_sensor import moved_after
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import moving_joints
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.losses import robust_scale

_SMALLER = 0.3
"""Part of the errors that may be left without a sensor that is wrong: a noisy robot keeps its. Two
that leave less unlike errors than this may both be."""
_TRIED = 40
"""Samples on which sensors are left out, or readings mended."""
_FEWEST = 10
"""Observations of a link that tell how large errors usually are."""
FEW_STARTS = 2
"""First bodies that are tried for each; as many as ever where errors fall, but are no noise yet."""
_MOST_BEHIND = 0.5
"""Share of what a camera saw from which on it is not a few wrong labels that lie behind it."""

Search = Callable[[BodyDataset, int | None], FoundStart]
"""Finds a first body of a recording, of so many at most if that is told."""


def refuse_odd_sensor(found: FoundStart, data: BodyDataset, search: Search, seed: int) -> None:
    """Refuse a recording that no body explains, but for one of several sensors that may be wrong.

    Each sensor in turn is left out where some errors are no noise. It is wrong where a body learned
    without explains all others, and these see all joints that it sees: else a joint may be wrong.

    Args:
        found: The first body of all.
        data: The recording.
        search: Finds a first body.
        seed: Of which samples are drawn.

    Raises:
        DataError: If there are such sensors.
    """
    worst = largest_error(found, data)
    if worst < LARGEST_NOISE or explained_by_lag(found):
        return
    few, parameters = some_samples(data, seed), found.start.parameters
    left_by = dict[str, float]()
    for s, sensor in enumerate(data.sensors):
        rest = few.observations.sensor != s
        if sensor.kind not in (*SIGHTS, DISTANCE) or rest.all() or not rest.any():
            continue
        left = few.of_rows(rest)
        if (moving_joints(left, parameters) != moving_joints(few, parameters)).any():
            continue
        for most in (FEW_STARTS, None):
            try:
                left_by[sensor.name] = largest_error(search(left, most), left)
            except SelfModelError:
                break
            if not LARGEST_NOISE < left_by[sensor.name] < _SMALLER * worst:
                break
    least = min(left_by.values(), default=np.inf)
    if least < min(LARGEST_NOISE, _SMALLER * worst):
        _refuse_left_handed(few, search, min(LARGEST_NOISE, _SMALLER * worst))
        wrong = [name for name, error in left_by.items() if error < least / _SMALLER]
        _refuse_moved(wrong, data, search, seed, min(LARGEST_NOISE, _SMALLER * worst))
        raise DataError(_words(wrong, data.name))


def _refuse_moved(
    wrong: list[str], data: BodyDataset, search: Search, seed: int, largest: float
) -> None:
    """Refuse sensors of which what they saw before and after some sample fits, each by itself.

    Args:
        wrong: Sensors that may be.
        data: The recording.
        search: Finds a first body.
        seed: Of which samples are drawn.
        largest: Usual error above which it does not fit, in the spread of all.

    Raises:
        DataError: If there are such.
    """

    def fits(part: BodyDataset) -> FoundStart | None:
        few = some_samples(part, seed)
        with suppress(SelfModelError):
            found = search(few, FEW_STARTS)
            return found if largest_error(found, few) < largest else None
        return None

    names, said = [sensor.name for sensor in data.sensors], []
    for name in wrong:
        last = moved_after(data, names.index(name), fits)
        if last is not None:
            said.append(f"sensor {name!r} of data set {data.name!r} moved after sample {last}")
    if said:
        raise DataError(
            f"{', or '.join(said)}: what it told before and what it told after fits all the rest, "
            "each by itself; learn from one part alone, or record again"
        )


def _refuse_left_handed(few: BodyDataset, search: Search, largest: float) -> None:
    """Refuse a tracker of points by which, one axis negated, a recording fits that else does not.

    Who is left-handed, it or the cameras, nothing tells.

    Args:
        few: Some of the samples.
        search: Finds a first body.
        largest: Usual error above which it does not fit, in the spread of all.

    Raises:
        DataError: If there is one.
    """
    table = few.observations
    for s, sensor in enumerate(few.sensors):
        own = table.sensor == s
        if sensor.kind != POINTS or not own.any():
            continue
        values = table.values.copy()
        values[own, 1] *= -1.0
        turned = replace(few, observations=replace(table, values=values))
        fits = False
        with suppress(SelfModelError):
            fits = largest_error(search(turned, None), turned) < largest
        if fits:
            raise DataError(
                f"what sensor {sensor.name!r} of data set {few.name!r} measured fits the rest if "
                "one of its axes is negated, and does not as it is: it is left-handed, or pictures "
                "are mirrored (x, y, z must be right-handed, u run to the right and v down)"
            )


def some_samples(data: BodyDataset, seed: int) -> BodyDataset:
    """Return as many samples, drawn at random, as tell whether a recording fits.

    Args:
        data: The recording.
        seed: Of the draw.
    """
    drawn = np.random.default_rng((seed, 11)).permutation(len(data.sample))
    return data.select(drawn < _TRIED)


def largest_error(found: FoundStart, data: BodyDataset) -> float:
    """Return the largest usual error of what a sensor saw of a link, in the spread of all."""
    return max(errors_by_link(found, data).values(), default=0.0)


def errors_by_link(found: FoundStart, data: BodyDataset) -> dict[int, float]:
    """Return the largest usual error of what a sensor saw of each link, in the spread of all."""
    seen, start = TreeObservations.of(data), found.start
    r = TreeResiduals(seen, start.parameters).residuals(start.values)
    largest = dict[int, float]()
    for rows in (rows for rows in seen.sensors if rows.kind in SIGHTS):
        off = np.linalg.norm(r[rows.scalars].reshape(rows.measured.shape)[:, :3], axis=1)
        link, k = data.seen_on[rows.rows], min(rows.measured.shape[1], 3)
        for one in np.unique(link).tolist():
            own = off[link == one]
            if len(own) >= _FEWEST:
                usual = robust_scale(own, k) / spread_of(rows)
                largest[one] = max(largest.get(one, 0.0), usual)
    return largest


def spread_of(rows: SensorRows) -> float:
    """Return how far what a sensor saw is spread [m or px]."""
    squares = float(np.sum(np.var(rows.measured[:, :3], axis=0)))
    return max(np.sqrt(squares), np.finfo(float).tiny)


def _words(wrong: list[str], name: str) -> str:
    check = (
        "check units, lenses, the order and direction of axes (u, v; x, y, z are right-handed), "
        "names and links of markers, and that readings and what was seen are of the same moments"
    )
    if len(wrong) == 1:
        return (
            f"what sensor {wrong[0]!r} of data set {name!r} tells contradicts all the rest, which "
            f"fits without it: {check}"
        )
    return (
        f"sensors of data set {name!r} contradict each other, without "
        f"{' or '.join(map(repr, wrong))} the rest fits: {check}"
    )


def refuse_behind(tree: BodyTree, observations: TreeObservations) -> None:
    """Refuse a body of which cameras would see what is behind them.

    A world turned inside out through a camera, p -> -p, has the same pixels: a body that a
    left-handed tracker and cameras saw fits both, and stands behind these.

    Args:
        tree: The body as it was learned.
        observations: What it was learned from.

    Raises:
        DataError: If most of what a camera saw lies behind it.
    """
    data = observations.data
    if data.free_joints:  # boards begin before the cameras that saw them
        return
    behind = _behind(tree, data, observations)
    if not behind:
        return
    rest = [s.name for s in data.sensors if s.kind != CAMERA]
    what = f"what {listed(rest)} measured" if rest else "the robot as it is described"
    raise DataError(
        f"what {listed(behind)} of data set {data.name!r} saw lies behind as {what} has it: one of "
        "them is left-handed (x, y, z must be right-handed, u run to the right and v down): negate "
        "one of its axes"
    )


def _behind(tree: BodyTree, data: BodyDataset, observations: TreeObservations) -> list[str]:
    """Return the names of cameras most of whose sights lie behind them."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    names = [sensor.name for sensor in tree.sensors]
    counts = dict[str, list[int]]()
    for rows in observations.sensors:
        if rows.kind != CAMERA or rows.name not in names:
            continue
        R_WS, p_WS = motion.pose_of(tree.sensors[names.index(rows.name)])
        p_WM = motion.points(rows.marker, rows.pose)
        if rows.mirror:
            p_WM = reflect(tree.mirror(rows.mirror).plane, p_WM)
        away = p_WM.T - p_WS[:, rows.pose]
        depth = np.einsum("jn,jn->n", R_WS[:, 2, rows.pose], away)
        one = counts.setdefault(rows.name, [0, 0])
        one[0] += int((depth < 0.0).sum())
        one[1] += len(depth)
    return [name for name, (off, of) in counts.items() if off > _MOST_BEHIND * of]
