"""A body that watches itself while it works."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value  # pyright: ignore[reportAttributeAccessIssue]
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from nico_selfmodel.dataset.approach import Sides
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import ModelError, check_kind
from nico_selfmodel.estimation.monitoring.diagnosis import Diagnosis, hypotheses, ranked_causes
from nico_selfmodel.estimation.monitoring.health import dated
from nico_selfmodel.estimation.monitoring.monitor import Monitor
from nico_selfmodel.estimation.monitoring.monitored_changes import monitored_changes
from nico_selfmodel.estimation.noise.hand_observations import covariance_of, hand_observations_of
from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.noise.training_noise import expected_noise
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel

REMEMBERED = 100
"""Poses kept to tell the cause of a change."""


@dataclass(frozen=True, eq=False)
class MonitorState:
    """What a monitor remembers."""

    monitor: Monitor
    """The statistic; it stands still after the alarm."""
    sides: Sides
    """From which side each joint came, by successive readings."""
    nis: float = np.nan
    """Of the last pose; nan where the hand was not seen, or a joint not read."""
    recent: PoseResiduals | None = None
    """The last poses, for the diagnosis."""
    since: int | None = None
    """First of them after the change; None before the alarm."""
    diagnosis: Diagnosis | None = None
    """What changed, after the alarm."""


class SelfModelMonitor(LeafSystem):
    """Hold each new pose of the hand against a self-model, and say when it no longer fits.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | encoder readings, in the encoders' units, nan of a joint that is not read |
    | `pixels` | in | left u, v and right u, v of the hand, nan where a camera did not see it [px] |
    | `nis` | out | normalised innovation squared of the last pose, nan if not seen or read |
    | `log_ratio` | out | statistic ln R; above `monitor.THRESHOLD` something changed |
    | `alarm` | out | 1 once something changed, else 0 |
    | `cause` | out | what changed in words, empty before the alarm (abstract, str) |

    A model without cameras has the port `p_WH_measured` instead of `pixels`, the hand's measured
    point [m]. It looks every `period` seconds, and tells by successive readings from which side
    joints came, which backlash is seen by. Only what changes from pose to pose is news to it: a
    hand that stands still should be looked at once.
    """

    def __init__(self, model: SelfModel, period: float = 0.1, marker: str | None = None) -> None:
        """Take a self-model.

        Args:
            model: With its covariance; with both cameras it watches pixels, else points.
            period: Time between measurements [s].
            marker: Which tracked point; the first one if omitted.

        Raises:
            TypeError: If it is no self-model.
            ModelError: If the model does not say how well it is known, or what noise to expect.
            ValueError: If there is no such marker, or the period is not positive.
        """
        super().__init__()
        check_kind(model, SelfModel, "give a self-model; a body is checked by check_health")
        if not period > 0.0:
            raise ValueError(f"period must be positive, got {period}")
        if model.covariance is None:
            raise ModelError(
                f"self-model {model.name!r} does not say how well it is known: learn it first"
            )
        self.model = model
        self.marker = model.markers[model.chain.marker_index(marker or model.markers[0])]
        self._by_pixels = set(model.cameras) == set(SIDES)
        self._sensor = "pixels" if self._by_pixels else "points"
        self._joints = _joints_of(model)
        names = model.parameters.names + (model.rig.names if self._by_pixels else ())
        self._covariance, self._causes = covariance_of(model, names), hypotheses(model, names)
        self._changes = monitored_changes(model, names)
        self._noise = expected_noise(model, self._sensor)
        self._encoders = self.DeclareVectorInputPort("encoders", len(model.joints))
        name, size = ("pixels", 4) if self._by_pixels else ("p_WH_measured", 3)
        self._detection = self.DeclareVectorInputPort(name, size)
        first = MonitorState(Monitor.of(self._changes.weights), Sides.of(self._joints))
        self._state = self.DeclareAbstractState(Value(first))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._look)
        needs = {self.abstract_state_ticket(self._state)}
        for port in ("nis", "log_ratio", "alarm"):
            self.DeclareVectorOutputPort(port, BasicVector(1), _writer(self, port), needs)
        self.DeclareAbstractOutputPort("cause", lambda: Value(""), self._say, needs)

    def state_of(self, context: Context) -> MonitorState:
        """Return what a context of this system remembers."""
        state: Any = context.get_abstract_state(int(self._state))
        return state.get_value()

    def _look(self, context: Context, state: State) -> None:
        """Take one more measurement in."""
        encoders = np.asarray(self._encoders.Eval(context), dtype=float)
        before = self.state_of(context)
        before = replace(before, sides=before.sides.after(encoders))
        seen = np.asarray(self._detection.Eval(context), dtype=float)
        holder = state.get_mutable_abstract_state(int(self._state))
        # A camera needs both of its coordinates, a point all three.
        by_camera = np.isfinite(seen).reshape((2, 2) if self._by_pixels else (1, 3)).all(axis=1)
        if not by_camera.any() or not np.isfinite(encoders).all():
            holder.set_value(replace(before, nis=np.nan))
            return
        pose = self._pose(encoders, seen, before.sides)
        new = PoseResiduals.of(hand_observations_of(self.model, pose, self._sensor))
        density = MixtureDensity(new, self._noise, self._covariance)
        nis = float(density.nis(new.residuals)[0])
        step = self._changes.steps(density, new.residuals, new.slopes)[0]
        holder.set_value(replace(self._after(before, new, step), nis=nis))

    def _after(self, before: MonitorState, new: PoseResiduals, step: NDArray) -> MonitorState:
        """Return what is remembered after one more pose."""
        monitor = before.monitor if before.monitor.alarm else before.monitor.after(step)
        recent = new if before.recent is None else PoseResiduals.together((before.recent, new))
        lost = max(len(recent) - REMEMBERED, 0)
        recent = recent.select(slice(lost, None))
        if not monitor.alarm:
            return MonitorState(monitor, before.sides, recent=recent)
        what = recent, self._noise, self._covariance, self._causes
        if before.since is None:
            count = len(recent)
            first = max(count - (monitor.poses - monitor.changed_at), 0)
            since, found = dated(*what, first, count - 1)
        else:
            since = max(before.since - lost, 0)
            found = ranked_causes(*what, since)
        return MonitorState(monitor, before.sides, np.nan, recent, since, found[0])

    def _pose(self, encoders: NDArray, seen: NDArray, sides: Sides) -> Dataset:
        column = {"pixels": seen[None]} if self._by_pixels else {"p_WH_measured": seen[None]}
        return Dataset(
            name="observation",
            joints=self._joints,
            sample=np.array([1]),
            encoders=encoders[None],
            approach=sides.side[None],
            marker=np.array([self.marker]),
            **column,
        )

    def _say(self, context: Context, cause: Value) -> None:
        diagnosis = self.state_of(context).diagnosis
        cause.set_value("" if diagnosis is None else diagnosis.hypothesis.cause)


def _writer(monitor: SelfModelMonitor, port: str) -> Callable[[Context, BasicVector], None]:
    def write(context: Context, vector: BasicVector) -> None:
        state = monitor.state_of(context)
        value = state.nis if port == "nis" else float(getattr(state.monitor, port))
        vector.SetFromVector([value])

    return write


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
