"""A few parameters of a known body learned anew: the rest is held, but not taken for exact."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.results.unobservable_words import why_so_few_are_refused
from nico_selfmodel.estimation.tree.contradictions.wrong_readings import read_wrongly, seen_wrongly
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.known.known_with_errors import (
    NewParameters,
    drifts_of,
    new_parameters,
)
from nico_selfmodel.estimation.tree.timing.moved_meanwhile import Granted, moved_meanwhile
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration, refit_tree
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.optimization.uncertainty import Uncertainty, root_of

_STEPS = 3
"""From what fits an exact body best to what fits one that may err: nearly linear."""
_NOISE_KNOWN_TO = 0.05
"""Share of a standard deviation by which that of new poses may differ from training's."""
_FITS = 4.0
"""Standard deviations of the misfit beyond which the rest of the body no longer fits."""


@dataclass(frozen=True, eq=False)
class LearnedAnew:
    """Parameters that were learned anew in a known body."""

    found: TreeCalibration
    """Their adjustment; its uncertainty counts the body's own."""
    covariance: ParameterCovariance
    """Of what was known and what was learned, together."""
    misfit: float
    """Sum of squared innovations, what the rest is uncertain by included."""
    expected: float
    """What `misfit` is to be expected to be."""
    spread: float
    """Standard deviation of `misfit` about that."""
    problem: TreeProblem
    """In which all that may err is free."""
    solution: TreeSolution
    """Where `problem` is, at what was learned."""
    learned: NDArray
    """Numbers of what was learned among what is free in `problem`. Shape (p,)."""
    may_err: NDArray
    """Ways in which the rest may err, each as large as expected, N(0, 1). Shape (free, k)."""
    set_aside: NDArray
    """Outliers among the observations that depend on what was learned. Boolean, shape (n,)."""
    read_wrongly: tuple[str, ...]
    """Joints that would have been read wrongly in more poses than a few of those that show them."""
    seen_wrongly: tuple[str, ...]
    """Links of which more than a few observations are outliers."""

    @property
    def fits(self) -> bool:
        """Whether the rest of the body explains what was not set aside, as it did in training.

        Poses that contradict are another matter, see `monitoring.body_relearning.BodyUpdate`.
        """
        surplus = self.misfit - self.expected
        return surplus < _FITS * self.spread and not (self.read_wrongly or self.seen_wrongly)

    def asked_what_changed(self) -> "LearnedAnew":
        """Return the same with what changed in the middle of the recording, if anything did."""
        granted = Granted(self.learned, self.may_err)
        change = moved_meanwhile(self.problem, self.solution, granted)
        if change is not None and not self.fits:
            # Joints gave way to it in some poses, and observations were set aside for it.
            change = replace(change, ratio=np.inf)
        return replace(self, found=replace(self.found, meanwhile=change))

    def body(self, model: BodyModel, name: str | None = None) -> BodyModel:
        """Return a body with what was learned in it; what else is known of it stays as it was."""
        return replace(
            model, name=name or model.name, tree=self.found.tree, covariance=self.covariance
        )


@on_one_blas_thread
def learn_anew(
    model: BodyModel,
    tree: BodyTree,
    told: BodyDataset,
    names: frozenset[str],
    *,
    noise: TreeNoise | None = None,
    name: str | None = None,
    test: BodyDataset | None = None,
    begin: BodyTree | None = None,
) -> LearnedAnew:
    """Learn parameters of a known body anew.

    Args:
        model: The body as it was.
        tree: The body as it was, with what is new in it: what turns and shifts are told from.
        told: The recording, in the tree's markers.
        names: What is learned.
        noise: What disturbs the recording; estimated if omitted.
        name: Of what was learned; the body's if omitted.
        test: Held-out data, for judging only.
        begin: Where the search begins; `tree` if omitted.

    Raises:
        DataError: If the recording has fewer numbers than there are parameters.
        NotIdentifiableError: If the poses leave a parameter open; it is named.
    """
    found = refit_tree(
        tree,
        told,
        names,
        world=str(model.provenance.get("world", "world")),
        name=name or model.name,
        noise=noise,
        test=test,
        start=model.name,
        begin=begin,
    )
    if open_ways := found.uncertainty.unobservable:
        zeros = [f"{joint}.{part}" for joint in tree.joints for part in ("rz", "z")]
        count = f"{len(told.sample)} poses are"
        raise NotIdentifiableError(why_so_few_are_refused(count, open_ways, zeros))
    return _with_errors_of_body(found, _without(model.covariance, found.uncertainty.names))


def _with_errors_of_body(found: TreeCalibration, body: ParameterCovariance) -> LearnedAnew:
    """Return what was learned with the body's errors counted, moved to where these put it."""
    residuals = TreeResiduals(found.train.observations, found.parameters)
    new = found.uncertainty.names
    drifts = drifts_of(found.tree, found.train.observations, new)
    bends = TreeResiduals(residuals.observations, residuals.parameters.with_bending(drifts.bending))
    free = frozenset((*new, *body.names, *drifts.names))
    problem = TreeProblem(bends, free, {}, found.solution.noise, noise_known=True)
    names, still = problem.free_names, np.zeros(len(bends.parameters.names) - len(found.values))
    own, known, drifting = ([names.index(n) for n in s] for s in (new, body.names, drifts.names))
    L = root_of(body.matrix)
    largest, solution = float(found.solution.noise.joint.max(initial=0.0)), found.solution

    def at(solution: TreeSolution) -> TreeSolution:
        return replace(solution, values=np.append(solution.values, still))

    def weighed(solution: TreeSolution) -> tuple[NewParameters, int]:
        U, white = problem.whitened_at(at(solution))
        drift = U[:, drifting] * drifts.scale
        return new_parameters(U[:, own], U[:, known] @ L, drift, white, largest), len(white)

    for _ in range(_STEPS):
        values = solution.values.copy()
        values[problem.columns[own]] += weighed(solution)[0].step
        solution = replace(solution, values=values)
    last, count = weighed(solution)
    may_err = np.zeros((len(names), L.shape[1] + len(drifting)))
    may_err[known, : L.shape[1]] = L
    may_err[drifting, L.shape[1] :] = np.diag(last.drift * drifts.scale)
    uncertainty = _uncertainty(found, new, last.information, count)
    across = last.with_body @ L.T
    matrix = np.block([[body.matrix, across.T], [across, uncertainty.covariance]])
    moved = replace(
        found,
        tree=found.parameters.tree_of(solution.values),
        solution=solution,
        uncertainty=uncertainty,
        train=TreeErrors(found.train.observations, residuals.residuals(solution.values)),
    )
    covariance = ParameterCovariance((*body.names, *new), matrix)
    expected = float(count - len(new))
    # A sum of n squares scatters by sqrt(2 n), and by twice what the noise is known to.
    spread = float(np.hypot(np.sqrt(2.0 * expected), 2.0 * _NOISE_KNOWN_TO * expected))
    return LearnedAnew(
        moved,
        covariance,
        last.squares,
        expected,
        spread,
        problem,
        at(solution),
        np.array(own, dtype=int),
        may_err,
        *_set_aside(residuals, found),
    )


def _set_aside(
    residuals: TreeResiduals, found: TreeCalibration
) -> tuple[NDArray, tuple[str, ...], tuple[str, ...]]:
    """Return outliers of what depends on what was learned, joints and links that do not fit."""
    seen, solution = residuals.observations, found.solution
    linear = residuals.linear(found.values)
    columns = [found.parameters.index[name] for name in found.uncertainty.names]
    shown = np.unique(seen.row[(linear.J[columns] != 0.0).any(axis=0)])
    wrong = tuple(read_wrongly(linear, seen, solution))
    return solution.outliers[shown], wrong, tuple(seen_wrongly(seen, solution))


def _uncertainty(
    found: TreeCalibration, names: tuple[str, ...], information: NDArray, count: int
) -> Uncertainty:
    """Return the covariance of what is new; the noise is that of the body's training, or found."""
    squares, vectors = np.linalg.eigh(information)
    root = np.sqrt(np.maximum(squares, 0.0))[:, None] * vectors.T
    scales = found.parameters.scales(1.0, found.values)
    natural = scales[[found.parameters.index[name] for name in names]]
    return Uncertainty.from_jacobian(names, root, natural, float(count - len(names)), count)


def _without(body: ParameterCovariance | None, names: tuple[str, ...]) -> ParameterCovariance:
    """Return what is known of a body, not of what is learned anew."""
    if body is None:
        return ParameterCovariance((), np.zeros((0, 0)))
    kept = [i for i, name in enumerate(body.names) if name not in names]
    return ParameterCovariance(tuple(body.names[i] for i in kept), body.matrix[np.ix_(kept, kept)])
