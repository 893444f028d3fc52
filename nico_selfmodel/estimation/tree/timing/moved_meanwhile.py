"""What did not stay where it was while a body was recorded.

The score test of `estimation.diagnosis.changes_in_time` on any body: an encoder that jumped, a
marker that was knocked, a camera, tracker or mirror that was moved, after any sample, by and by or
at once. Observations and readings that were set aside take part: what contradicts all that was
before is no noise. Wrong detections here and there do not.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, POSES, SIGHTS
from nico_selfmodel.estimation.diagnosis.changes_in_time import (
    FEWEST_VISITS,
    Change,
    Words,
    encoder_words,
    likeliest_change,
    mirror_words,
    mixed_in_time,
    moved_words,
)
from nico_selfmodel.estimation.diagnosis.jump_taken_for_noise import jump_taken_for_noise
from nico_selfmodel.estimation.diagnosis.score_sums import MARGIN, CourseFound, Left, ScoreSums
from nico_selfmodel.estimation.tree.forward.joint_errors import MOST_SLIPS, shown_errors
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.noise.noise_evidence import tree_whitening
from nico_selfmodel.estimation.tree.timing.lone_outliers import lone_outliers
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TURNS
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.geometry.rotation import (
    rotation_vector_of,
    rotation_vector_slope,
    slope_together,
)
from nico_selfmodel.model.tree.body_tree import FLANGE, PRISMATIC, WHOLE_POSES, WORLD_NAME, Attached

LEAST_RATIO = 1.02
"""Mean residual of what a change moves, without it over with it, below which nobody is told."""
_FEWEST_WHOLE = 2 * (MARGIN + 1)
"""Poses of one flange that are told and seen whole, or by corners that tell as much, below which no
change is looked for: each tells six numbers of twelve that are unknown, where those of an arm are
`FEWEST_VISITS`."""
_FEWEST_OF_KNOWN = 14
"""Poses of a known body below which no change is looked for."""
_FEWEST_CORNERS = 6
"""Corners of known place in most pictures of a camera that is taken to tell whole poses."""
_AT_ONCE = 0.5
"""Difference of the shares of slips before and after a sample from which on they began there."""
_MOST_NUMBERS = 1e7
"""Of sums over spans of time that are kept: fewer spans of many parameters."""
_MOST_SPANS, _FEWEST_SPANS = 400, 20


@dataclass(frozen=True, eq=False)
class Granted:
    """What a body that is known may err by at all times, while a part of it was learned anew."""

    learned: NDArray
    """Places of what was learned among what is free. Shape (p,)."""
    may_err: NDArray
    """Ways in which what is free may err, each as large as it is expected to be: their coordinates
    are N(0, 1). Shape (free, m)."""

    @property
    def ways(self) -> NDArray:
        """Changes of what is free by what was learned, then by errors. Shape (free, p + m)."""
        return np.hstack([np.eye(len(self.may_err))[:, self.learned], self.may_err])

    @property
    def prior(self) -> NDArray:
        """What is known of these beforehand: one standard deviation is likely. (m, p + m)."""
        return np.eye(self.may_err.shape[1] + len(self.learned))[len(self.learned) :]


def moved_meanwhile(
    problem: TreeProblem, solution: TreeSolution, granted: Granted | None = None
) -> Change | None:
    """Find what changed in the middle of a recording.

    Args:
        granted: Of a body that is known, what it may err by; all that is free is learned else.

    Returns:
        The change that explains most, or None where there is none.
    """
    seen, data = problem.observations, problem.observations.data
    rank, timed = _order(problem)
    fewest = _fewest(data) if granted is None else _FEWEST_OF_KNOWN
    if len(np.unique(rank[timed])) < fewest or not solution.variances_known:
        return None
    last = np.full(rank.max() + 1, np.iinfo(data.sample.dtype).min)
    np.maximum.at(last, rank[timed], data.sample[timed])
    linear = problem.residuals.linear(solution.values)
    ways = np.eye(len(problem.free_names)) if granted is None else granted.ways
    groups, columns = _groups(problem, linear, solution, ways.shape[1])
    far = np.sqrt(seen.per_row((linear.r / problem.scale) ** 2))
    lone = lone_outliers(data, solution.outliers, far)
    row = seen.row[~lone[seen.row]]
    white, left = _left(problem, solution, linear, ways, columns, rank[seen.sample], lone)
    size = white.shape[1] ** 2
    most = int(np.clip(_MOST_NUMBERS / size, _FEWEST_SPANS, _MOST_SPANS))
    free = ways.shape[1]
    if granted is None:
        prior = solution.whitened[-len(problem.priors) or len(solution.whitened) :]
        pull = -solution.rest[len(solution.rest) - len(prior) :]
    else:
        prior, pull = granted.prior, np.zeros(granted.may_err.shape[1])
    pulled = prior * left.scale[:free], pull
    sums = ScoreSums.of(white, left.visit, left, np.arange(free), last, pulled, row, most)

    def mixed(found: CourseFound) -> bool:
        spans = np.minimum(np.searchsorted(sums.last, data.sample), len(found.course) - 1)
        return mixed_in_time(data.si_readings, found.course[spans])

    change = likeliest_change(sums, groups, mixed)
    often = solution.slipped.mean(axis=0) > MOST_SLIPS
    if change is not None and (granted or (change.explains and not often.any())):
        return change
    jump = _jumped(problem, solution)
    if change is None or (jump and (not change.explains or jump.ratio > change.ratio)):
        change = jump
    return None if change is None or change.ratio < LEAST_RATIO else change


def doubted_joints(
    problem: TreeProblem, solution: TreeSolution
) -> Iterator[tuple[int, NDArray, NDArray]]:
    """Yield joints that are read worse than others, or wrongly in most poses, and their errors.

    What the poses show of such a joint, whatever it was read to, are its errors.

    Returns:
        Which of `TreeObservations.noisy_joints`, samples that show it in the order of time, shape
        (N,), and its errors there.
    """
    seen, of_all = problem.observations, solution.joint_errors
    often = solution.slipped.mean(axis=0) > MOST_SLIPS
    if of_all is None:
        return
    if often.any():
        of_all = np.where(often, _shown(problem, solution), of_all)
    order = np.argsort(seen.data.sample)
    for k in sorted({*solution.noise.loud, *np.flatnonzero(often & ~seen.unread).tolist()}):
        at = order[of_all[order, k] != 0.0]
        yield k, at, of_all[at, k]


def _jumped(problem: TreeProblem, solution: TreeSolution) -> Change | None:
    """Find a jump of an encoder that is read worse than others, or wrongly in most poses."""
    data = problem.observations.data
    for k, at, errors in doubted_joints(problem, solution):
        joint = data.joints[problem.observations.noisy_joints[k][0]]
        readings = data.si_readings[:, data.joints.index(joint)]
        jump = jump_taken_for_noise(errors, readings[at], data.sample[at])
        if jump is None:
            continue
        course = (data.sample > jump.last).astype(float)
        line = np.stack([np.ones(len(course)), readings], axis=1)
        before, after = (
            _left_beside(
                problem, solution, k, one @ np.linalg.lstsq(one[at], errors, rcond=None)[0]
            )
            for one in (line, np.column_stack([line, course]))
        )
        words = encoder_words(joint.name, joint.motion == PRISMATIC)
        what = f"{words(np.array([jump.size]), False)} after sample {jump.last}"
        return Change(what, before / after, mixed_in_time(data.si_readings, course))
    return None


def _shown(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return what poses show of joints that were read wrongly in them. Shape (samples, m)."""
    seen, groups = problem.observations, problem.observations.groups(solution.outliers)
    loose = seen.unread_in(groups.poses, solution.slipped_in(groups.numbers))
    linear = problem.residuals.linear(solution.values)
    whitening = tree_whitening(seen, linear, groups, solution.noise, loose)
    return shown_errors(seen, whitening, linear.r / problem.scale, loose)


def _left_beside(problem: TreeProblem, solution: TreeSolution, k: int, errors: NDArray) -> float:
    """Return the mean residual of what a joint moves, in sigmas, as it errs by (samples,)."""
    off = np.zeros((len(errors), len(problem.observations.noisy_joints)))
    off[:, k] = errors
    linear = problem.residuals.erring(off).linear(solution.values)
    assert linear.pulled is not None
    return float(
        np.abs((linear.r + linear.pulled) / problem.scale)[linear.by_joint[:, k] != 0].mean()
    )


def _fewest(data: BodyDataset) -> int:
    """Return how many visits tell whether anything changed."""
    told = [joint.motion for joint in data.joints] == [FLANGE]
    whole = told and all(
        sensor.kind == POSES or _shows_poses(data, s) for s, sensor in enumerate(data.sensors)
    )
    return _FEWEST_WHOLE if whole else FEWEST_VISITS


def _shows_poses(data: BodyDataset, sensor: int) -> bool:
    """Whether a camera sees so many corners of known place that each picture tells a whole pose."""
    table = data.observations
    known = np.array([marker.xyz is not None for marker in data.markers])[table.marker]
    own = known & (table.sensor == sensor) & (table.pose != ANY_POSE)
    counts = np.unique(table.pose[own], return_counts=True)[1]
    return data.sensors[sensor].kind == CAMERA and bool(
        len(counts) and np.median(counts) >= _FEWEST_CORNERS
    )


def _order(problem: TreeProblem) -> tuple[NDArray, NDArray]:
    """Return of each sample its visit's place in the order of time, and whether it has one.

    Boards that were photographed besides, while no joint moved what was seen, may have been so at
    any time: their visits are dealt out evenly among the others. Where they stand behind these,
    what corners of boards and other markers have unlike looks like a change.
    """
    seen, visit = problem.observations, problem.observations.data.visit
    sample = seen.data.sample
    others = np.unique(visit[seen.sample[~seen.apart]])
    timed = np.isin(visit, others) if len(others) else np.ones(len(visit), dtype=bool)
    first = np.full(visit.max() + 1, np.iinfo(sample.dtype).max)
    np.minimum.at(first, visit, sample)
    place = np.zeros(len(first), dtype=int)
    known, besides = np.unique(visit[timed]), np.unique(visit[~timed])
    place[known] = np.argsort(np.argsort(first[known]))
    place[besides] = np.linspace(0, len(known) - 1, len(besides)).round()
    return place[visit], timed


def _left(
    problem: TreeProblem,
    solution: TreeSolution,
    linear: TreeLinear,
    ways: NDArray,
    columns: NDArray,
    visit: NDArray,
    lone: NDArray,
) -> tuple[NDArray, Left]:
    """Return residuals and derivatives, whitened and as they are in their sensors' sigmas.

    Args:
        ways: Changes of what is free by which the derivatives are. Shape (free, k).
        columns: Derivatives beside these. Shape (R, c).
        visit: Of each number. Shape (R,).
        lone: Observations that take no part. Boolean, by row of the table, shape (N,).
    """
    kept = ~lone[problem.observations.row]
    taken = replace(solution, outliers=lone, slipped=_now_and_then(problem, solution))
    U, white = problem.whitened_at(taken, columns)
    U = np.column_stack([U[:, : len(ways)] @ ways, U[:, len(ways) :]])
    by_all = np.column_stack([linear.J[problem.columns].T @ ways, columns]) / problem.scale[:, None]
    # Those of what nobody tells are 0.
    scale = 1.0 / np.maximum(np.linalg.norm(by_all, axis=0), np.finfo(float).tiny)
    residuals = -(linear.r / problem.scale)[kept, None]
    left = Left(residuals, (by_all * scale)[kept, None, :], scale, visit[kept])
    return np.column_stack([-white, U * scale]), left


def _now_and_then(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return slips of joints that slip at all times alike: these tell of no change. (visits, m)."""
    data, slipped = problem.observations.data, solution.slipped
    seen = np.unique(data.visit[data.visit < len(slipped)], return_index=True)
    order = seen[0][np.argsort(data.sample[seen[1]])]
    before = np.cumsum(slipped[order], axis=0)
    count = np.arange(1, len(order) + 1)[:, None]
    after = (before[-1] - before) / np.maximum(len(order) - count, 1)
    inside = (count >= FEWEST_VISITS // 2) & (count <= len(order) - FEWEST_VISITS // 2)
    apart = np.where(inside, np.abs(after - before / count), 0.0).max(axis=0)
    return slipped & (apart < _AT_ONCE)


def _groups(
    problem: TreeProblem, linear: TreeLinear, solution: TreeSolution, free: int
) -> tuple[list[tuple[Words, list[int]]], NDArray]:
    """Return what may change together, with its words, and columns beside so many free ones."""
    found: list[tuple[Words, list[int]]] = []
    columns: list[NDArray] = []
    for words, parts in _changes(problem, linear, solution):
        kept = [part for part in parts if part.any()]
        if len(kept) == len(parts):
            found.append((words, list(range(free + len(columns), free + len(columns) + len(kept)))))
            columns.extend(kept)
    return found, np.array(columns).T.reshape(len(linear.r), -1)


def _changes(
    problem: TreeProblem, linear: TreeLinear, solution: TreeSolution
) -> Iterator[tuple[Words, list[NDArray]]]:
    """Yield words and derivatives of what may change together."""
    seen, parameters = problem.observations, problem.residuals.parameters
    data, base, index = seen.data, parameters.base, parameters.index
    for k, (i, part) in enumerate(seen.noisy_joints):
        motion, name = data.joints[i].motion, data.joints[i].name
        if motion not in WHOLE_POSES and not part:
            yield encoder_words(name, motion == PRISMATIC), [linear.by_joint[:, k]]
    table, count = data.observations, len(data.markers)
    kept = (table.pose != ANY_POSE) & ~solution.outliers
    told = np.bincount(table.marker[kept], minlength=count)
    # One that stands still before a standing sensor moves as that sensor does.
    carried = np.array([data.on_link(sensor.on) >= 0 for sensor in data.sensors])
    passing = np.bincount(table.marker[carried[table.sensor]], minlength=count) > 0
    passing |= [data.on_link(marker.on) >= 0 for marker in data.markers]
    tree, together = parameters.tree_of(solution.values), dict[str, list[Attached]]()
    seen_often = (told >= _fewest(data)) & passing
    for marker, placed, often in zip(data.markers, tree.markers, seen_often, strict=True):
        places, turns = ([f"{marker.name}.{part}" for part in parts] for parts in (SHIFTS, TURNS))
        if not often or places[0] not in index:
            continue  # corners of a board have no place of their own
        together.setdefault(marker.on, []).append(placed)
        where = "on its link" if data.on_link(marker.on) >= 0 else "in the room"
        what, shifts = f"marker {marker.name!r}", [linear.J[index[name]] for name in places]
        yield _shifted(f"{what} {{}} {where}"), shifts
        if turns[0] in index:
            yield moved_words(what), [*shifts, *(linear.J[index[name]] for name in turns)]
    for rows in {rows.name: rows for rows in seen.sensors if rows.kind in SIGHTS}.values():
        names = [f"{rows.name}.{part}" for part in (*SHIFTS, *TURNS)]
        yield moved_words(f"sensor {rows.name!r}"), [linear.J[index[name]] for name in names]
    for link, markers in together.items():
        if len(markers) > 1:
            where = "in the room" if link == WORLD_NAME else f"on {link!r}"
            yield moved_words(f"what carries markers {where}"), _as_one(markers, linear, index)
    for mirror in base.mirrors:
        columns = [linear.J[index[name]] for name in mirror.names]
        yield mirror_words(mirror.name), columns


def _as_one(markers: list[Attached], linear: TreeLinear, index: dict[str, int]) -> list[NDArray]:
    """Return derivatives by what shifts and turns markers of a link together.

    A turn exp(u) goes by w = J du, J the left Jacobian.
    """
    places = slope_together([marker.X_LA[:3, 3] for marker in markers])
    out = np.zeros((6, len(linear.r)))
    for marker, slope in zip(markers, places, strict=True):
        out += slope.T @ linear.J[[index[f"{marker.name}.{part}"] for part in SHIFTS]]
        if f"{marker.name}.{TURNS[0]}" in index:
            own = linear.J[[index[f"{marker.name}.{part}"] for part in TURNS]]
            left = rotation_vector_slope(rotation_vector_of(marker.X_LA[:3, :3]))
            out[3:] += np.linalg.inv(left).T @ own
    return [*out]


def _shifted(what: str) -> Words:
    def words(size: NDArray, drift: bool) -> str:
        far = 1e3 * float(np.linalg.norm(size))
        return f"{what.format('wandered' if drift else 'slipped')} by about {far:.2g} mm"

    return words
