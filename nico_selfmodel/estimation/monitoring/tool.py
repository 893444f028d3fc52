"""A tool in the hand becomes part of the body; encoder zeros come back after a restart.

The thesis retrains every kinematic parameter on 52 poses with the tool (section 8.4.4) and ends
above its own hand's error: 23 parameters where the tip needs three.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError, ModelError, NotIdentifiableError
from nico_selfmodel.estimation.monitoring.block_update import (
    BlockUpdate,
    learn_block,
    learn_with_prior,
)
from nico_selfmodel.estimation.monitoring.zero_search import likely_offsets
from nico_selfmodel.estimation.noise.hand_observations import HandObservations, hand_observations_of
from nico_selfmodel.estimation.observations.parameter_scales import arm_size
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed, refuse_unknown

_SPREAD = 3.0
"""The hand must move by this many times what one pose is uncertain by."""
_DIFFERENT = 3.0
"""Standard deviations by which a tip must lie off the hand to be one."""


@dataclass(frozen=True, eq=False)
class ToolCalibration:
    """A body with a tool's tip as a further tracked point."""

    model: SelfModel
    """The body; the tip is one of its markers."""
    tool: str
    """Name of the tip among the markers."""
    update: BlockUpdate
    """What was learned, and whether the rest still fits."""
    train: NDArray
    """Errors of the observations: in the images [px], or in space [m]. Shape (n,)."""
    test: NDArray | None
    """The same on held-out data."""
    test_poses: int
    """Held-out poses."""
    sensor: str
    """`pixels` or `points`."""
    known: bool
    """Whether the tip was a tracked point before, which has moved."""
    reach: float
    """Distance of the tip from the hand's own point, of a known point from where it was [m]."""
    reach_sigma: float
    """Standard deviation of `reach` [m]."""
    seconds: float

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the result should not be trusted; empty if it may."""
        words = []
        if not self.update.fits:
            words.append(
                f"the body no longer fits: {self.update.misfit_words}; run `nico-selfmodel "
                "monitor` to see what changed"
            )
        if not self.known and self.reach < _DIFFERENT * self.reach_sigma:
            words.append(
                f"the tip lies {1e3 * self.reach:.1f} mm from the hand's own point, known to "
                f"{1e3 * self.reach_sigma:.1f} mm: no tool can be told from the bare hand"
            )
        return tuple(words)


@dataclass(frozen=True, eq=False)
class Rezeroing:
    """A body whose encoder zeros were found again."""

    model: SelfModel
    """The body with its new zeros."""
    update: BlockUpdate
    """What was learned, and whether the rest still fits."""
    shifts: NDArray
    """By how much each zero moved, as an angle of the joint [rad]. Shape (n,)."""
    seconds: float


@on_one_blas_thread
def calibrate_tool(
    model: SelfModel,
    dataset: Dataset,
    *,
    tool: str | None = None,
    free: str = "point",
    sensor: str = "auto",
    test: Dataset | None = None,
    loss: str = "trimmed",
) -> ToolCalibration:
    """Learn where a tool's tip is.

    Args:
        model: The body without the tool.
        dataset: Encoder readings, and pixels or measured points of the tip; points of the hand
            beside it are left out.
        tool: Name of the tip among the markers; see `of_tip`.
        free: `point`: the tip alone. `body`: everything else too, with what is known of it as
            prior; worth while from about 20 poses.
        sensor: `pixels`, `points` or `auto`.
        test: Held-out data of the tip.
        loss: Of poses: one of `optimization.robust_solve.ROBUST_METHODS`.

    Returns:
        The calibration; see `reasons` for what speaks against it.

    Raises:
        DataError: If the data do not suit the model, or nothing was seen.
        ModelError: If the model knows no noise.
        NotIdentifiableError: If the hand hardly moved.
        ValueError: If `free` or `sensor` is unknown, or nothing tells which point is the tip.
    """
    if free not in ("point", "body"):
        raise ValueError(f"free must be 'point' or 'body', got {free!r}")
    clock = time.perf_counter()
    data = of_tip(model, dataset, tool)
    tool = str(data.marker[0])
    held = with_marker(model, tool)
    observations = hand_observations_of(held, data, sensor)
    names = tuple(f"hand.{tool}.{axis}" for axis in "xyz")
    _require_motion(observations, names)
    scales = np.full(3, arm_size(model))
    learn = learn_block if free == "point" else learn_with_prior
    update = learn(held, observations, names, scales=scales, loss=loss)
    learned = update.model
    known = tool in model.markers
    reach, reach_sigma = _reach(model if known else learned, learned, tool, update)
    kind = "pixels" if observations.seen.shape[1] == 4 else "points"
    tested, poses = None, 0
    if test is not None:
        held_out = hand_observations_of(learned, of_tip(model, test, tool), kind)
        tested, poses = errors_of(held_out), len(np.unique(held_out.sample))
    return ToolCalibration(
        learned,
        tool,
        update,
        errors_of(hand_observations_of(learned, data, kind)),
        tested,
        poses,
        kind,
        known,
        reach,
        reach_sigma,
        time.perf_counter() - clock,
    )


@on_one_blas_thread
def rezero(
    model: SelfModel,
    dataset: Dataset,
    *,
    joints: tuple[str, ...] | None = None,
    sensor: str = "auto",
    loss: str = "trimmed",
) -> Rezeroing:
    """Find the encoders' zeros again after a restart, everything else held.

    Args:
        model: The body as it was.
        dataset: Three to five poses: encoder readings, and pixels or measured points.
        joints: Joints whose zeros are lost; all if omitted.
        sensor: `pixels`, `points` or `auto`.
        loss: Of poses: one of `optimization.robust_solve.ROBUST_METHODS`.

    Raises:
        DataError: If the data do not suit the model, or what was seen are no more numbers than
            zeros.
        ModelError: If the model knows no noise.
        NotIdentifiableError: If the poses leave a zero open; it names them.
        ValueError: If there is no such joint.
    """
    clock = time.perf_counter()
    joints = joints or model.joints
    for joint in joints:
        refuse_unknown("joint", joint, model.joints)
    observations = hand_observations_of(model, dataset, sensor)
    names = tuple(f"{joint}.theta_offset" for joint in joints)
    update = learn_block(model, observations, names, scales=np.ones(len(names)), loss=loss)
    numbers = int(observations.seen.sum())
    if numbers <= len(names):
        raise DataError(
            f"{numbers} numbers measured for {len(names)} zeros leave none to check them by: "
            "record three to five poses, or name the joints that lost theirs"
        )
    if not update.fits:
        update = _from_other_zeros(model, dataset, joints, update, sensor, loss)
    after = update.model.servos
    shifts = (model.servos.offset - after.offset) / after.gear
    # Whole turns of a joint are no shift: the hand is where it was.
    turns = 2.0 * np.pi * np.round(shifts / (2.0 * np.pi))
    nearest = replace(after, offset=after.offset + after.gear * turns)
    update = replace(update, model=replace(update.model, servo_map=nearest))
    return Rezeroing(update.model, update, shifts - turns, time.perf_counter() - clock)


def _from_other_zeros(
    model: SelfModel,
    dataset: Dataset,
    joints: tuple[str, ...],
    update: BlockUpdate,
    sensor: str,
    loss: str,
) -> BlockUpdate:
    """Look for zeros far from the old ones.

    Returns:
        The first that fits; where none does, the one that leaves fewest outliers and least misfit.
    """
    best = update
    for offset in likely_offsets(model, hand_observations_of(model, dataset, sensor), joints):
        start = replace(model, servo_map=replace(model.servos, offset=offset))
        observations = hand_observations_of(start, dataset, sensor)
        scales = np.ones(len(joints))
        try:
            found = learn_block(start, observations, update.learned, scales=scales, loss=loss)
        except (NotIdentifiableError, ModelError):
            continue
        if found.fits:
            return found
        best = min(best, found, key=lambda u: (int(u.outliers.sum()), u.misfit))
    return best


def errors_of(observations: HandObservations) -> NDArray:
    """Return the errors of observations: in each image [px], or in space [m]. Shape (n,)."""
    predicted, _ = observations.block.project(observations.x)
    miss = np.where(observations.seen, (observations.block.measured - predicted).T, np.nan)
    width = 2 if miss.shape[1] == 4 else 3
    errors = np.linalg.norm(miss.reshape(-1, width), axis=1)
    return errors[np.isfinite(errors)]


def of_tip(model: SelfModel, dataset: Dataset, tool: str | None = None) -> Dataset:
    """Return the rows of data that show a tool's tip, under its name.

    Where the data show but one point that is the body's own, that point is the tip: a tracker that
    knows one thing calls it the hand, whatever is in the hand.

    Args:
        model: The body without the tool.
        tool: Name of the tip; if omitted that of the point that the body does not know, or `tool`.

    Raises:
        ValueError: If there is no such point, or several may be the tip.
    """
    seen = dataset.measured | np.isfinite(dataset.pixels).any(axis=1)
    named = list(dict.fromkeys(dataset.marker[seen].tolist()))
    new = [name for name in named if name not in model.markers]
    if len(named) > 1 and tool is None and len(new) != 1:
        raise ValueError(
            f"data set {dataset.name!r} tracks {listed(named)}, of which the self-model knows "
            f"{listed(model.markers)}: name the tip by --tool"
        )
    if tool is not None and tool not in named and (new or len(named) > 1):
        raise ValueError(
            f"data set {dataset.name!r} tracks no point {tool!r}; there are {listed(named, tool)}"
        )
    tool = tool or (new[0] if new else "tool")
    rows = dataset if len(named) < 2 else dataset.select(dataset.marker == tool)
    return replace(rows, marker=np.full(len(rows), tool))


def with_marker(model: SelfModel, tool: str) -> SelfModel:
    """Return the body with a tracked point where its first one is, to be learned anew.

    Args:
        tool: Name of the point; the body stays as it is if it has it.
    """
    table = model.dh
    if tool in table.markers:
        return model
    hands = np.vstack([table.p_NH, table.p_NH[:1]])
    rows = {name: getattr(table, name) for name in ("D", "theta_zero", "r", "alpha", "beta")}
    wider = DhTable(table.joints, table.X_W0, **rows, markers=(*table.markers, tool), p_NH=hands)
    return replace(model, table=wider)


def _require_motion(observations: HandObservations, names: tuple[str, ...]) -> None:
    """Refuse poses that are all alike: what they say of `names` holds nowhere else."""
    predicted, _ = observations.block.project(observations.x)
    slopes = observations.block.by_angle(observations.x)
    noise = np.sqrt(np.mean(np.trace(observations.noise.covariance(slopes), axis1=1, axis2=2)))
    moved = float(np.sqrt(np.sum(np.var(predicted, axis=1))))
    if moved >= _SPREAD * noise:
        return
    pixels = observations.seen.shape[1] == 4
    scale, unit = (1.0, "px") if pixels else (1e3, "mm")
    count = np.unique(observations.sample).size
    poses = "1 pose" if count == 1 else f"{count} poses"
    raise NotIdentifiableError(
        f"the hand moved by {scale * moved:.1f} {unit} in {poses}, one pose alone "
        f"is uncertain by {scale * noise:.1f} {unit}: {', '.join(names)} cannot be told from what "
        "disturbs the joints; record poses that spread over the workspace"
    )


def _reach(
    before: SelfModel, learned: SelfModel, tool: str, update: BlockUpdate
) -> tuple[float, float]:
    """Return how far the tip is from where it was, else from the hand, and its sigma [m]."""
    old, new = before.dh, learned.dh
    place = old.p_NH[old.markers.index(tool)] if before is not learned else new.p_NH[0]
    arm = new.p_NH[new.markers.index(tool)] - place
    reach = float(np.linalg.norm(arm))
    covariance = learned.covariance
    assert covariance is not None
    own = [covariance.names.index(name) for name in update.learned]
    spread = covariance.matrix[np.ix_(own, own)]
    if reach == 0.0:
        return 0.0, float(np.sqrt(np.trace(spread)))
    direction = arm / reach
    return reach, float(np.sqrt(direction @ spread @ direction))
