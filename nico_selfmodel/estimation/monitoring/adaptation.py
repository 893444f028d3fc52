"""A body that keeps learning while it works: observation by observation, or over a window.

Both wait to be told what changed (`forget`): a filter without process noise would need hundreds of
poses to give up an old zero, and one that may change everything always forgets what it knew.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.monitoring.block_update import learn_with_prior
from nico_selfmodel.estimation.noise.hand_observations import (
    covariance_of,
    hand_observations_of,
    with_values,
)
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.names import listed

_UNKNOWN = {"rad": np.radians(20.0), "m": 0.15, "1": 0.1, "px": 30.0}
"""Standard deviations of a parameter that was forgotten."""
_GATE = 25.0
"""NIS in units of its expectation beyond which an observation is a false detection."""


class Adaptation(Protocol):
    """A body that learns from new observations.

    Attributes:
        model: The body as it is known now.
    """

    @property
    def model(self) -> SelfModel:
        """The body as it is known now."""
        ...

    def update(self, dataset: Dataset) -> SelfModel:
        """Learn from new observations, in their order, and return the body."""
        ...

    def forget(self, names: tuple[str, ...]) -> None:
        """Take parameters as unknown from now on: they changed."""
        ...


@dataclass(frozen=True)
class Drift:
    """How much a body changes by itself from one observation to the next, standard deviations."""

    zero: float = np.radians(0.01)
    """Of each encoder zero [rad]."""
    point: float = 1e-5
    """Of each coordinate of a tracked point [m]."""


class RecursiveAdaptation:
    """An extended Kalman filter over the parameters that the model's covariance names."""

    def __init__(
        self, model: SelfModel, *, drift: Drift | None = None, sensor: str = "auto"
    ) -> None:
        """Start from a body.

        Args:
            model: The body with its covariance.
            drift: How it changes by itself; `Drift()` if omitted.
            sensor: `pixels`, `points` or `auto`.

        Raises:
            ModelError: If the model has no covariance.
        """
        _require_covariance(model)
        self._model, self._sensor = model, sensor
        self._drift = Drift() if drift is None else drift

    @property
    def model(self) -> SelfModel:
        """The body as it is known now."""
        return self._model

    def forget(self, names: tuple[str, ...]) -> None:
        """Take parameters as unknown from now on: they changed.

        Raises:
            ValueError: If the model has no such parameter.
        """
        self._model = forgotten(self._model, names)

    def update(self, dataset: Dataset) -> SelfModel:
        """Learn from new observations, one after the other.

        Args:
            dataset: Encoder readings, and pixels or measured points.

        Returns:
            The body as it is known afterwards. Observations far off any change are left out.

        Raises:
            DataError: If the data do not suit the model, or nothing was seen.
        """
        rows = hand_observations_of(self._model, dataset, self._sensor).sample
        for number in dict.fromkeys(rows.tolist()):
            self._step(dataset.select(dataset.sample == number))
        return self._model

    def _step(self, pose: Dataset) -> None:
        """Joseph's form of the update: the covariance stays positive."""
        assert self._model.covariance is not None
        known = self._model.covariance.names
        observations = hand_observations_of(self._model, pose, self._sensor)
        names = observations.names
        free = np.array([i for i, name in enumerate(names) if name in known])
        whole = covariance_of(self._model, names) + np.diag(self._drift_of(names, known))
        noise = observations.whitening()
        x, prior = observations.x.copy(), whole[np.ix_(free, free)]
        new = observations.innovations(whole)
        if np.any(new.nis > _GATE * new.dof):
            return
        h = (noise @ new.slopes)[:, :, free].reshape(-1, len(free))
        v = (noise @ new.residuals[:, :, None]).ravel()
        seen = new.seen.ravel()
        h, v = h[seen], v[seen]
        gain = np.linalg.solve(h @ prior @ h.T + np.eye(len(v)), h @ prior).T
        rest = np.eye(len(free)) - gain @ h
        posterior = rest @ prior @ rest.T + gain @ gain.T
        x[free] += gain @ v
        moved = with_values(self._model, names, x)
        self._model = replace(moved, covariance=_with_block(self._model, names, free, posterior))

    def _drift_of(self, names: tuple[str, ...], known: tuple[str, ...]) -> NDArray:
        """Return the variance that each parameter gains from one pose to the next. Shape (P,)."""
        variance = np.zeros(len(names))
        for i, name in enumerate(names):
            if name in known and name.endswith(".theta_offset"):
                variance[i] = self._drift.zero**2
            elif name in known and name.startswith("hand."):
                variance[i] = self._drift.point**2
        return variance


class WindowAdaptation:
    """The last observations solved anew each time, with what was known before them as prior."""

    def __init__(self, model: SelfModel, *, size: int = 200, sensor: str = "auto") -> None:
        """Start from a body.

        Args:
            model: The body with its covariance: the prior of every window.
            size: Poses that are remembered.
            sensor: `pixels`, `points` or `auto`.

        Raises:
            ModelError: If the model has no covariance.
            ValueError: If no pose would be remembered.
        """
        _require_covariance(model)
        if size < 1:
            raise ValueError(f"the window must hold at least one pose, got {size}")
        self._prior = self._model = model
        self._size, self._sensor = size, sensor
        self._recent: Dataset | None = None

    @property
    def model(self) -> SelfModel:
        """The body as it is known now."""
        return self._model

    def forget(self, names: tuple[str, ...]) -> None:
        """Take parameters as unknown from now on; observations from before count no more.

        Raises:
            ValueError: If the model has no such parameter.
        """
        self._prior = self._model = forgotten(self._model, names)
        self._recent = None

    def update(self, dataset: Dataset) -> SelfModel:
        """Solve the window again with new observations.

        Args:
            dataset: Encoder readings, and pixels or measured points.

        Returns:
            The body as it is known afterwards.

        Raises:
            DataError: If the data do not suit the model, or nothing was seen.
        """
        self._recent = dataset if self._recent is None else joined(self._recent, dataset)
        last = self._recent.samples[-self._size :]
        self._recent = self._recent.select(np.isin(self._recent.sample, last))
        observations = hand_observations_of(self._prior, self._recent, self._sensor)
        found = learn_with_prior(self._prior, observations, (), scales=np.zeros(0))
        self._model = found.model
        return self._model


def forgotten(model: SelfModel, names: tuple[str, ...]) -> SelfModel:
    """Return a body that knows nothing of some parameters but where they were.

    Args:
        model: The body.
        names: Parameters of its covariance, or others that were held until now.

    Raises:
        ValueError: If it has no such parameter.
    """
    units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    if len(model.cameras) == 2:
        units |= dict(zip(model.rig.names, model.rig.units, strict=True))
    for name in names:
        if name not in units:
            raise ValueError(f"no parameter {name!r}; there are {listed(units, name)}")
    old = model.covariance
    known = () if old is None else old.names
    every = (*known, *(name for name in names if name not in known))
    matrix = np.zeros((len(every), len(every)))
    if old is not None:
        matrix[: len(known), : len(known)] = old.matrix
    for name in names:
        i = every.index(name)
        matrix[i], matrix[:, i] = 0.0, 0.0
        matrix[i, i] = _UNKNOWN[units[name]] ** 2
    return replace(model, covariance=ParameterCovariance(every, matrix))


def joined(first: Dataset, second: Dataset) -> Dataset:
    """Return the rows of two data sets of one body, the poses of the second numbered on.

    Args:
        first: Earlier rows.
        second: Later rows, of the same joints.

    Raises:
        ValueError: If the joints differ.
    """
    if first.joint_names != second.joint_names:
        raise ValueError("data sets of different joints cannot be joined")
    arrays = ("encoders", "p_WH_measured", "sweep", "marker", "pixels", "mirror")
    both = {k: np.concatenate([getattr(d, k) for d in (first, second)]) for k in arrays}
    start = first.sample.max() + 1 - second.sample.min()
    sample = np.concatenate([first.sample, second.sample + start])
    return replace(first, sample=sample, extra={}, **both)


def _with_block(
    model: SelfModel, names: tuple[str, ...], places: NDArray, block: NDArray
) -> ParameterCovariance:
    """Return the model's covariance with a block of it replaced.

    Parameters outside the observations, as of mirrors, keep theirs and their correlations are lost.
    """
    assert model.covariance is not None
    old = model.covariance
    updated = tuple(names[i] for i in places)
    others = [i for i, name in enumerate(old.names) if name not in updated]
    kept = tuple(old.names[i] for i in others)
    size = len(kept) + len(updated)
    matrix = np.zeros((size, size))
    matrix[: len(kept), : len(kept)] = old.matrix[np.ix_(others, others)]
    matrix[len(kept) :, len(kept) :] = 0.5 * (block + block.T)
    return ParameterCovariance((*kept, *updated), matrix)


def _require_covariance(model: SelfModel) -> None:
    if model.covariance is None:
        raise ModelError(
            f"self-model {model.name!r} does not say how well it is known: learn it before it can "
            "adapt"
        )
