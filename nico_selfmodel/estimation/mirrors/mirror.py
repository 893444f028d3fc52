"""Infer mirrors from watching one's own hand in them (thesis, chapter 9)."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.held_out import held_out_of
from nico_selfmodel.errors import DataError, NotIdentifiableError
from nico_selfmodel.estimation.diagnosis.changes_in_time import Change
from nico_selfmodel.estimation.diagnosis.flatness import Flatness
from nico_selfmodel.estimation.mirrors.mirror_cameras import fit_mirror_cameras
from nico_selfmodel.estimation.mirrors.mirror_changes import change_of_mirrors
from nico_selfmodel.estimation.mirrors.mirror_checks import (
    misplaced_rows,
    require_reflections,
    unnamed_reflections,
)
from nico_selfmodel.estimation.mirrors.mirror_evaluation import (
    MirrorEvaluation,
    cross_validate_mirrors,
)
from nico_selfmodel.estimation.mirrors.mirror_flatness import flatness_of
from nico_selfmodel.estimation.mirrors.mirror_solution import (
    MirrorSolution,
    solve_mirrors,
    start_mirrors,
)
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections, known_points
from nico_selfmodel.estimation.results.provenance import data_named, package_versions
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.names import listed, refuse_unknown
from nico_selfmodel.optimization.robust_solve import ROBUST_METHODS

_ASSUMED_PIXEL_SIGMA = 1.0


@dataclass(frozen=True, eq=False)
class MirrorCalibration:
    """Mirrors learned from reflections of the hand, with everything known about how."""

    model: SelfModel
    """The self-model with the mirrors added."""
    solution: MirrorSolution
    """Planes, residuals, outliers and uncertainty."""
    starts: Mapping[str, Mirror]
    """Where the adjustment began: closed form, one pose being enough."""
    flatness: Mapping[str, Flatness | None]
    """The test for a bent mirror; None where there are too few poses."""
    train: MirrorEvaluation
    """The mirrors on their own data, outliers included."""
    test: MirrorEvaluation | None
    """The mirrors on held-out data."""
    cross_validation: MirrorEvaluation | None
    """Inlier rows predicted without their own fold; None where a mirror has one pose alone."""
    free_cameras: Mapping[str, MirrorEvaluation | None]
    """The thesis' two free cameras on the inliers of each mirror; None with too few rows."""
    misplaced: NDArray
    """Samples of rows called direct views that are reflections. Shape (k,)."""
    loss: str
    """How rows that contradict the rest were treated."""
    seconds: float
    """Time taken."""

    @property
    def mirrors(self) -> dict[str, Mirror]:
        """What was learned, by name."""
        names = self.solution.reflections.mirrors
        return dict(zip(names, self.solution.mirrors, strict=True))

    @cached_property
    def change(self) -> Change | None:
        """What changed while the reflections were recorded."""
        return change_of_mirrors(self.solution, self.model.joints)

    @property
    def covariance(self) -> ParameterCovariance | None:
        """Of arm, cameras and mirrors together; None where nothing is known of arm and cameras.

        Mirrors that were learned through one arm and one pair of cameras err alike.
        """
        known, follows = self.model.covariance, self.solution.shared
        errors = self.solution.reflections.shared
        if known is None or follows is None or errors is None:
            return None
        planes = self.solution.uncertainty
        shared = follows[:, [errors.names.index(name) for name in known.names]]
        matrix = np.block([[known.matrix, shared.T], [shared, planes.covariance]])
        return ParameterCovariance((*known.names, *planes.names), matrix)


@on_one_blas_thread
def calibrate_mirrors(
    dataset: Dataset,
    model: SelfModel,
    *,
    test: Dataset | None = None,
    joint_sigma: float | None = None,
    loss: str = "trimmed",
    name: str | None = None,
) -> MirrorCalibration:
    """Learn the plane of every mirror in which the hand was seen.

    Arm and cameras are held as the model has them. One pose is enough for a plane; ten are good.

    Args:
        dataset: Poses with pixels; rows that name a mirror are reflections in it.
        test: Held-out data, for judging only.
        joint_sigma: Standard deviation of a joint's play [rad]; by default what the model's
            training left, or what explains its `noise_sigma`.
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.
        name: Name of the new self-model; the old one's if omitted.

    Returns:
        The calibration. A failed check does not raise: see `estimation.judging.judge`.

    Raises:
        DataError: If the reflections are direct views, no row names a mirror, the hand lies
            behind one, or held-out rows stand in the data too.
        ModelError: If the model has no arm or no cameras.
        NotIdentifiableError: If the reflections leave a plane open.
        NotConvergedError: If no plane fits.
        ValueError: If the loss is unknown or `joint_sigma` negative.
    """
    refuse_unknown("loss", loss, ROBUST_METHODS)
    began = time.perf_counter()
    test = None if test is None else held_out_of(dataset, test)
    noise = _noise_of(dataset, model, joint_sigma)
    reflections = _reflections_of(dataset, model, noise)
    require_reflections(reflections, noise)
    starts = start_mirrors(reflections)
    solution = solve_mirrors(reflections, starts, noise, loss)
    mirrors = dict(zip(reflections.mirrors, solution.mirrors, strict=True))
    misplaced = misplaced_rows(dataset, model, mirrors, noise)
    return MirrorCalibration(
        _learned(model, mirrors, solution, dataset, name),
        solution,
        dict(zip(reflections.mirrors, starts, strict=True)),
        {mirror: _flatness(solution, m) for m, mirror in enumerate(reflections.mirrors)},
        MirrorEvaluation.from_reflections(reflections, solution.mirrors),
        None if test is None else evaluate_mirrors(test, model, mirrors),
        cross_validate_mirrors(solution),
        {mirror: _free_cameras(solution, mirror) for mirror in reflections.mirrors},
        np.unique(dataset.sample[misplaced]),
        loss,
        time.perf_counter() - began,
    )


def evaluate_mirrors(
    dataset: Dataset, model: SelfModel, mirrors: Mapping[str, Mirror]
) -> MirrorEvaluation:
    """Hold mirrors against other data.

    Args:
        dataset: Poses with pixels seen in these mirrors.

    Raises:
        DataError: If a mirror is not known, or nothing was seen in one.
        ModelError: If the model has no arm or no cameras.
    """
    reflections = Reflections.from_dataset(dataset, model)
    unknown = [name for name in reflections.mirrors if name not in mirrors]
    if unknown:
        raise DataError(
            f"data set {dataset.name!r} has reflections in {listed(unknown)}, which was not "
            f"learned; there are: {listed(mirrors)}"
        )
    planes = tuple(mirrors[name] for name in reflections.mirrors)
    return MirrorEvaluation.from_reflections(reflections, planes)


def _noise_of(dataset: Dataset, model: SelfModel, joint_sigma: float | None) -> ReflectionNoise:
    """Return what the data set and the model say of noise; the joints' from the hand's if need be.

    What the training left is joint noise with its tail. Joint noise is the body's own: points that
    the arm was learned from tell it better than pixels, of which arm and cameras together may be
    wrong by more than joints are loose. A model without that says how the hand scatters: joints
    that scatter by as much over the mean lever explain it.
    """
    if joint_sigma is not None and not 0.0 <= joint_sigma <= np.pi:
        raise ValueError(
            f"joint_sigma must lie between 0 and pi rad (180 deg), got {joint_sigma:.6g} rad"
        )
    pixel_sigma = dataset.pixel_sigma_px or model.pixel_sigma or _ASSUMED_PIXEL_SIGMA
    known = model.noise_mixtures
    if joint_sigma is None and known:
        joint_sigma = known.get("points", next(iter(known.values()))).rms_joint_sigma
    if joint_sigma is None:
        by_angle = known_points(dataset, model, np.arange(len(dataset))).by_angle
        lever = float(np.sqrt(np.mean(np.sum(by_angle**2, axis=(1, 2))) / 3.0))
        joint_sigma = (model.noise_sigma or 0.0) / lever if lever > 0.0 else 0.0
    return ReflectionNoise(pixel_sigma, joint_sigma)


def _reflections_of(dataset: Dataset, model: SelfModel, noise: ReflectionNoise) -> Reflections:
    """Take the reflections, or say what there is instead."""
    try:
        return Reflections.from_dataset(dataset, model)
    except DataError as error:
        if (dataset.mirror != "").any():
            raise
        raise DataError(f"{error}{unnamed_reflections(dataset, model, noise)}") from error


def _flatness(solution: MirrorSolution, m: int) -> Flatness | None:
    """Test one mirror on its inlier rows."""
    reflections = solution.reflections
    rows = (reflections.mirror == m) & ~solution.outliers & (solution.in_front_by > 0.0)
    if not rows.any():
        return None
    own = reflections.select(rows).of(reflections.mirrors[m])
    return flatness_of(own, solution.mirrors[m], solution.noise)


def _free_cameras(solution: MirrorSolution, mirror: str) -> MirrorEvaluation | None:
    """Hold the thesis' free cameras against the reflections that they were fitted to."""
    own = solution.reflections.select(~solution.outliers).of(mirror)
    try:
        return fit_mirror_cameras(own).evaluate(own)
    except NotIdentifiableError:
        return None


def _learned(
    model: SelfModel,
    mirrors: Mapping[str, Mirror],
    solution: MirrorSolution,
    dataset: Dataset,
    name: str | None,
) -> SelfModel:
    """Return the self-model with the mirrors added; mirrors of other names are kept."""
    inliers = solution.distances[~solution.outliers]
    fit = {
        "rows": int((~solution.outliers).sum()),
        "rms_px": float(np.sqrt(np.nanmean(inliers**2))),
        "joint_sigma": solution.noise.joint_sigma,
        "pixel_sigma_px": solution.noise.pixel_sigma,
    }
    source = data_named(dataset)
    return replace(
        model,
        name=name or model.name,
        mirrors={**model.mirrors, **mirrors},
        covariance=_without(model.covariance, mirrors),
        fit={**model.fit, "mirrors": fit},
        provenance={**model.provenance, "mirrors": {**source, **package_versions("drake")}},
    )


def _without(
    covariance: ParameterCovariance | None, mirrors: Mapping[str, Mirror]
) -> ParameterCovariance | None:
    """Drop what was known of planes that are replaced."""
    replaced = {name for mirror in mirrors for name in Mirror.names_of(mirror)}
    if covariance is None or not replaced & set(covariance.names):
        return covariance
    kept = [i for i, name in enumerate(covariance.names) if name not in replaced]
    names = tuple(covariance.names[i] for i in kept)
    return ParameterCovariance(names, covariance.matrix[np.ix_(kept, kept)])
