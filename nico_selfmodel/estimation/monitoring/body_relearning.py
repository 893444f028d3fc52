"""What is learned anew in a body of any tree, and nothing else: causes, encoder zeros, a tool."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import POSES
from nico_selfmodel.errors import ContradictedError, DataError, ModelError
from nico_selfmodel.estimation.monitoring.body_health import body_contradictions
from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.noise.contradictions import Contradictions
from nico_selfmodel.estimation.results.verdict import outliers_are_many
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.known.learned_anew import LearnedAnew, learn_anew
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors, errors_of, told_by
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, SHIFTS, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE, WORLD, Attached, BodyTree
from nico_selfmodel.names import listed, refuse_unknown

_ZERO = {REVOLUTE: "rz", PRISMATIC: "z"}
"""Part of a joint's frame that is another zero of its encoder."""


_ANGLES = np.radians(np.arange(-180.0, 180.0, 3.0))
"""Zeros of a joint that turns which are tried."""
_SWEEPS = 3
"""Over all joints."""
_CLOSE = 0.1
"""Errors count as close below this share of the typical one."""


@dataclass(frozen=True, eq=False)
class BodyUpdate:
    """A body of any tree of which a few parameters were learned anew."""

    method: str
    """`rezero`, `tool` or `relearn`."""
    model: BodyModel
    """The body with them."""
    anew: LearnedAnew
    """Their adjustment, and whether the rest still fits."""
    before: TreeErrors | None
    """What the body as it was leaves of the same recording; None where it had no such marker."""
    seconds: float
    """That it took."""
    joints: tuple[str, ...] = ()
    """Joints whose zeros were found again."""
    shifts: NDArray = field(default_factory=lambda: np.zeros(0))
    """By how much each zero moved, as a displacement of its joint [rad or m]. Shape (k,)."""
    tool: str | None = None
    """Name of the marker that is a tool's tip."""
    cause: str | None = None
    """What had changed, in words."""
    against: Contradictions | None = None
    """Poses that contradict the body with them; None where it does not say the noise."""

    @property
    def fits(self) -> bool:
        """Whether the rest explains what was seen, but for what false detections explain."""
        return _fits(self.anew, self.against)

    @property
    def found(self) -> TreeCalibration:
        """The adjustment."""
        return self.anew.found


@on_one_blas_thread
def relearn_body(model: BodyModel, data: BodyDataset, report: HealthReport) -> BodyUpdate:
    """Learn the likeliest cause anew from the poses since the change.

    Args:
        model: The body as it was.
        data: The recording in which it changed.
        report: What `check_body_health` says of it.

    Raises:
        DataError: If too little was seen since.
        ValueError: If the body is healthy.
    """
    if report.changed_at is None or not report.diagnoses:
        raise ValueError("nothing changed: there is nothing to learn anew")
    clock, cause = time.perf_counter(), report.diagnoses[0].hypothesis
    since = data.select(np.isin(data.sample, report.sample[report.changed_at :]))
    told = told_by(model, since)
    unseen = _unseen(told) & {name.rpartition(".")[0] for name in cause.names}
    names = (name for name in cause.names if name.rpartition(".")[0] not in unseen)
    # What else changed would be taken for noise, were that estimated anew.
    noise = noise_named(model.noise, TreeObservations.of(told))
    anew = learn_anew(model, model.tree, told, frozenset(names), noise=noise)
    after, before = anew.body(model), errors_of(model.tree, since)
    after = replace(after, tree=_carried_along(model.tree, after.tree, unseen))
    against, seconds = body_contradictions(after, since), time.perf_counter() - clock
    return BodyUpdate("relearn", after, anew, before, seconds, cause=cause.cause, against=against)


def _unseen(told: BodyDataset) -> set[str]:
    """Return the markers that a recording shows nothing of."""
    table = told.observations
    seen = {*table.marker.tolist(), *table.other.tolist()}
    return {marker.name for m, marker in enumerate(told.markers) if m not in seen}


def _carried_along(before: BodyTree, after: BodyTree, unseen: set[str]) -> BodyTree:
    """Return a body whose unseen markers moved on their link as the others there did."""
    markers = list(after.markers)
    for i, marker in enumerate(markers):
        if marker.name not in unseen:
            continue
        others = [k for k, m in enumerate(markers) if m.on == marker.on and m.name not in unseen]
        then, now = (np.array([m.X_LA[:3, 3] for m in tree.markers])[others]
                     for tree in (before, after))  # fmt: skip
        if len(others) < 3:
            continue
        found = Alignment.from_points(then, now)
        moved = transform(found.rotation, found.translation) @ marker.X_LA
        markers[i] = replace(marker, X_LA=moved)
    return after.with_markers(tuple(markers))


@on_one_blas_thread
def rezero_body(
    model: BodyModel, data: BodyDataset, joints: Sequence[str] | None = None
) -> BodyUpdate:
    """Find the encoders' zeros again after a restart, everything else held.

    A zero that moved is a joint's frame turned about, or shifted along, its own axis.

    Args:
        model: The body as it was.
        data: Three to five poses.
        joints: Joints whose zeros are lost; all that have encoders if omitted.

    Raises:
        ContradictedError: If nothing that was seen agrees with the rest of the body.
        DataError: If the recording is of another body, or has too few numbers.
        ModelError: If the body does not say what noise to expect.
        NotIdentifiableError: If the poses leave a zero open; it names them.
        ValueError: If there is no such joint, or it or none has an encoder.
    """
    clock, tree = time.perf_counter(), model.tree
    told = told_by(model, data)
    lost = _lost(tree, joints)
    zeros = [f"{joint}.{_ZERO[tree.motions[tree.joints.index(joint)]]}" for joint in lost]
    names, seen = frozenset(zeros), TreeObservations.of(told)
    near = _if_anything_fits(lambda: _relearned(model, tree, told, names))
    found, against = near, None
    if near is not None:
        against = body_contradictions(near.body(model), data)
    if found is None or not _fits(found, against):
        # No slope leads to a zero that is far away: zeros all over the turn are tried.
        far = _relearned(model, tree, told, names, begin=_likely_zeros(tree, seen, names))
        tries = [far] if near is None else [near, far]
        found = min(tries, key=lambda one: (int(one.set_aside.sum()), one.misfit))
        against = body_contradictions(found.body(model), data)
    parameters = found.found.parameters
    moved = found.found.values[[parameters.index[name] for name in zeros]]
    seconds = time.perf_counter() - clock
    before = errors_of(tree, data)
    after = found.body(model)
    return BodyUpdate("rezero", after, found, before, seconds, lost, moved, against=against)


@on_one_blas_thread
def calibrate_body_tool(
    model: BodyModel, data: BodyDataset, *, tool: str | None = None, test: BodyDataset | None = None
) -> BodyUpdate:
    """Learn where a tool's tip is on the link that holds it, everything else held.

    Args:
        model: The body without the tool.
        data: A recording that lists the tip among its markers, on its link.
        tool: Name of that marker; the one that the body does not know if omitted.
        test: Held-out data, for judging only.

    Raises:
        DataError: If the recording is of another body, or has too few numbers.
        ModelError: If the body does not say what noise to expect.
        NotIdentifiableError: If the poses leave the tip's place open.
        ValueError: If there is no such marker.
    """
    clock = time.perf_counter()
    name = _tool_name(model.tree, data, tool)
    known = name in [marker.name for marker in model.tree.markers]
    before = errors_of(model.tree, data) if known else None
    tree = model.tree if known else _with_tip(model.tree, data, name)
    told = told_by(replace(model, tree=tree), data)
    turned = _is_turned(data, name)
    names = frozenset(f"{name}.{part}" for part in (FRAME_PARTS if turned else SHIFTS))
    anew = _relearned(model, tree, told, names, test).asked_what_changed()
    after = anew.body(model)
    against, seconds = body_contradictions(after, data), time.perf_counter() - clock
    return BodyUpdate("tool", after, anew, before, seconds, tool=name, against=against)


def _if_anything_fits(learn: Callable[[], LearnedAnew]) -> LearnedAnew | None:
    """Return what was learned; None where all that was seen contradicts what is held."""
    try:
        return learn()
    except ContradictedError:
        return None


def _fits(anew: LearnedAnew, against: Contradictions | None) -> bool:
    """Return whether a body with what was learned in it fits, all poses counted."""
    if against is None:
        return anew.fits and outliers_are_many(anew.set_aside) is None
    return anew.fits and not against.too_many


def _relearned(
    model: BodyModel,
    tree: BodyTree,
    told: BodyDataset,
    names: frozenset[str],
    test: BodyDataset | None = None,
    begin: BodyTree | None = None,
) -> LearnedAnew:
    """Learn some parameters from a start that may be far: roughly first."""
    seen = TreeObservations.of(told)
    noise = noise_named(model.noise, seen)
    if noise is None:
        raise ModelError(
            f"body {model.name!r} does not say the noise of its sensors and joints, which a few "
            "poses do not tell: learn it with `calibrate body` or `learn --head`"
        )
    parameters = TreeParameters(tree)
    problem = TreeProblem(TreeResiduals(seen, parameters), names, {}, noise, noise_known=True)
    values, _ = problem.rough(parameters.values_of(begin or tree))
    near = parameters.tree_of(values)
    return learn_anew(model, tree, told, names, noise=noise, test=test, begin=near)


def _lost(tree: BodyTree, joints: Sequence[str] | None) -> tuple[str, ...]:
    """Return the joints whose zeros are lost, checked."""
    read = [
        name
        for i, name in enumerate(tree.joints)
        if tree.motions[i] in _ZERO and tree.coupling[i, i] == 1.0
    ]
    if not read:
        raise ValueError("the body has no joint with an encoder of its own, and so no zero")
    for joint in joints or ():
        refuse_unknown("joint", joint, tree.joints)
        if joint not in read:
            raise ValueError(f"joint {joint!r} has no encoder of its own, and so no zero")
    return tuple(joints or read)


def _tool_name(tree: BodyTree, data: BodyDataset, tool: str | None) -> str:
    """Return which marker of a recording is the tip."""
    listed_there = [marker.name for marker in data.markers]
    if tool is not None:
        refuse_unknown("marker", tool, listed_there)
        return tool
    new = [name for name in listed_there if name not in {m.name for m in tree.markers}]
    if len(new) != 1:
        found = "the body knows all of its markers" if not new else f"it has {listed(new)}"
        raise DataError(f"data set {data.name!r} does not tell which marker is the tip: {found}; "
                        "name it with --tool")  # fmt: skip
    return new[0]


def _with_tip(tree: BodyTree, data: BodyDataset, name: str) -> BodyTree:
    """Return a body with a marker on its link, where the link's other markers are."""
    (info,) = [marker for marker in data.markers if marker.name == name]
    if info.on != "world" and info.on not in tree.joints:
        raise DataError(f"marker {name!r} is on {info.on!r}, which the body does not have")
    on = WORLD if info.on == "world" else tree.joints.index(info.on)
    beside = [marker.X_LA for marker in tree.markers if marker.on == on]
    X = np.eye(4) if not beside else beside[0].copy()
    X[:3, 3] = np.mean([pose[:3, 3] for pose in beside], axis=0) if beside else 0.0
    tip = Attached(name, on, X, oriented=_is_turned(data, name))
    return tree.with_markers((*tree.markers, tip))


def _is_turned(data: BodyDataset, name: str) -> bool:
    """Return whether a sensor tells a marker's orientation."""
    table = data.observations
    kinds = np.array([sensor.kind for sensor in data.sensors])[table.sensor]
    mine = table.marker == [marker.name for marker in data.markers].index(name)
    return bool((kinds[mine] == POSES).any())


def _likely_zeros(tree: BodyTree, seen: TreeObservations, names: frozenset[str]) -> BodyTree:
    """Return a body whose zeros explain observations better than others all over the turn do.

    Of joints that turn they are tried joint by joint from the root, the others where they fit best
    so far; all but `names` is near the truth. See `zero_search` for an arm, whose zeros are tried
    together.
    """
    parameters = TreeParameters(tree)
    residuals = TreeResiduals(seen, parameters)
    values = parameters.values_of(tree)
    turned = [i for i, name in enumerate(parameters.names) if name in names and name[-2:] == "rz"]
    close = _CLOSE * float(np.nanmedian(_errors(residuals, values)))

    def score(values: NDArray) -> float:
        # Cauchy: a few observations that fit say more than many that nearly do.
        errors = np.nan_to_num(_errors(residuals, values) / close, nan=1e6, posinf=1e6)
        return float(np.sum(np.log1p(errors**2)))

    for _ in range(_SWEEPS):
        before = values.copy()
        for column in turned:
            trials = np.tile(values, (len(_ANGLES) + 1, 1))
            trials[1:, column] = _ANGLES
            values = trials[int(np.argmin([score(trial) for trial in trials]))]
        if np.array_equal(values, before):
            break
    return parameters.tree_of(values)


def _errors(residuals: TreeResiduals, values: NDArray) -> NDArray:
    """Return by how much each observation is missed, in its sensor's sigmas. Shape (N,)."""
    seen = residuals.observations
    r = residuals.residuals(values) / seen.stated_sigma[seen.noise_group]
    return np.sqrt(seen.per_row(r * r))
