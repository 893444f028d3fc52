"""A body that watches itself while it works."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value  # pyright: ignore[reportAttributeAccessIssue]
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from nico_selfmodel.dataset import Dataset, JointInfo
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.diagnosis import Diagnosis, diagnose
from nico_selfmodel.estimation.health import Watch, watched
from nico_selfmodel.estimation.sightings import Innovations, covariance_of, sightings_of
from nico_selfmodel.model import SelfModel
from nico_selfmodel.model.stereo_rig import EYES

REMEMBERED = 100
"""Sightings kept to tell the cause of a change."""


@dataclass(frozen=True, eq=False)
class MonitorState:
    """What a monitor remembers."""

    watch: Watch = field(default_factory=Watch)
    """The sums; they stand still after the alarm."""
    nis: float = np.nan
    """Of the last sighting; nan where the hand was not seen."""
    recent: tuple[Innovations, ...] = ()
    """The last sightings, for the diagnosis."""
    diagnosis: Diagnosis | None = None
    """What changed, after the alarm."""


class SelfModelMonitor(LeafSystem):
    """Hold each new sighting of the hand against a self-model, and say when it no longer fits.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | encoder readings, in the encoders' units |
    | `pixels` | in | left u, v and right u, v of the hand, nan where an eye did not see it [px] |
    | `nis` | out | normalised innovation squared of the last sighting, nan where there was none |
    | `excess` | out | cumulative excess of it; above `health.THRESHOLD` something changed |
    | `ratio` | out | likelihood ratio of a change; above `health.RATIO_THRESHOLD` likewise |
    | `slip` | out | log-likelihood of a joint's slip; above `health.SLIP_THRESHOLD` likewise |
    | `alarm` | out | 1 once something changed, else 0 |
    | `cause` | out | what changed in words, empty before the alarm (abstract, str) |

    A model without eyes has the port `p_WH` instead of `pixels`, the hand's measured point [m].
    It looks every `period` seconds. Only what changes from sighting to sighting is news to it: a
    hand that stands still should be looked at once.
    """

    def __init__(self, model: SelfModel, period: float = 0.1, marker: str | None = None) -> None:
        """Take a self-model.

        Args:
            model: With its covariance; with both eyes it watches pixels, else points.
            period: Time between sightings [s].
            marker: Which tracked point; the first one if omitted.

        Raises:
            ModelError: If the model does not say how well it is known.
            ValueError: If there is no such marker, or the period is not positive.
        """
        super().__init__()
        if not period > 0.0:
            raise ValueError(f"period must be positive, got {period}")
        if model.covariance is None:
            raise ModelError(
                f"self-model {model.name!r} does not say how well it is known: learn it first"
            )
        self.model = model
        self.marker = model.markers[model.chain.marker_index(marker or model.markers[0])]
        self._by_pixels = set(model.cameras) == set(EYES)
        self._joints = _joints_of(model)
        self._encoders = self.DeclareVectorInputPort("encoders", len(model.joints))
        name, size = ("pixels", 4) if self._by_pixels else ("p_WH", 3)
        self._sighting = self.DeclareVectorInputPort(name, size)
        self._state = self.DeclareAbstractState(Value(MonitorState()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        needs = {self.abstract_state_ticket(self._state)}
        for port in ("nis", "excess", "ratio", "slip", "alarm"):
            self.DeclareVectorOutputPort(port, BasicVector(1), _writer(self, port), needs)
        self.DeclareAbstractOutputPort("cause", lambda: Value(""), self._say, needs)

    def state_of(self, context: Context) -> MonitorState:
        """Return what a context of this system remembers."""
        state: Any = context.get_abstract_state(int(self._state))
        return state.get_value()

    def _look(self, context: Context, state: State) -> None:
        """Take one more sighting in."""
        before = self.state_of(context)
        seen = np.asarray(self._sighting.Eval(context), dtype=float)
        holder = state.get_mutable_abstract_state(int(self._state))
        # An eye needs both of its coordinates, a point all three.
        by_eye = np.isfinite(seen).reshape((2, 2) if self._by_pixels else (1, 3)).all(axis=1)
        if not by_eye.any():
            holder.set_value(replace(before, nis=np.nan))
            return
        pose = self._pose(np.asarray(self._encoders.Eval(context), dtype=float), seen)
        sightings = sightings_of(self.model, pose, "pixels" if self._by_pixels else "points")
        names = sightings.names
        new = sightings.innovations(covariance_of(self.model, names))
        watch = before.watch
        if not watch.alarm:
            r, slopes = new.whitened
            own = new.seen[0]
            watch = watch.after(r[0, own], *watched(self.model, names).of(slopes[0][own]))
        recent = (*before.recent, new)[-REMEMBERED:]
        diagnosis = before.diagnosis
        if watch.alarm:
            recent, since = _since(before, watch, recent)
            diagnosis = diagnose(self.model, names, _together(since))[0]
        holder.set_value(MonitorState(watch, float(new.nis[0]), recent, diagnosis))

    def _pose(self, encoders: NDArray, seen: NDArray) -> Dataset:
        column = {"pixels": seen[None]} if self._by_pixels else {"p_WH_measured": seen[None]}
        return Dataset(
            name="sighting",
            joints=self._joints,
            sample=np.array([1]),
            encoders=encoders[None],
            marker=np.array([self.marker]),
            **column,
        )

    def _say(self, context: Context, cause: Value) -> None:
        diagnosis = self.state_of(context).diagnosis
        cause.set_value("" if diagnosis is None else diagnosis.hypothesis.cause)


def _writer(monitor: SelfModelMonitor, port: str) -> Callable[[Context, BasicVector], None]:
    def write(context: Context, vector: BasicVector) -> None:
        state = monitor.state_of(context)
        value = state.nis if port == "nis" else float(getattr(state.watch, port))
        vector.SetFromVector([value])

    return write


def _since(
    before: MonitorState, watch: Watch, recent: tuple[Innovations, ...]
) -> tuple[tuple[Innovations, ...], tuple[Innovations, ...]]:
    """Return what to keep, and the sightings after the change: all that is kept from then on."""
    if before.watch.alarm:
        return recent, recent
    after = recent[-(watch.sightings - watch.changed_at) :]
    return after, after


def _together(rows: tuple[Innovations, ...]) -> Innovations:
    parts = ("residuals", "slopes", "covariance", "seen")
    return Innovations(*(np.concatenate([getattr(row, p) for row in rows]) for p in parts))


def _joints_of(model: SelfModel) -> tuple[JointInfo, ...]:
    """Return the joints as a data set of this body states them."""
    servos = model.servos
    return tuple(
        JointInfo(
            name,
            servos.unit[i],
            counts_per_turn=float(servos.counts_per_turn[i])
            if servos.unit[i] == "counts"
            else None,
            sign=int(servos.sign[i]),
        )
        for i, name in enumerate(servos.joints)
    )
