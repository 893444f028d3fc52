"""Whether mirrors, and the joints before them, stayed as they were while reflections were recorded.

The score test of `estimation.diagnosis.changes_in_time` on pixels of reflections. What arm and
cameras are wrong by at all times is granted, as likely as the self-model says.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.changes_in_time import (
    Change,
    encoder_words,
    likeliest_change,
    mirror_words,
    mixed_in_time,
)
from nico_selfmodel.estimation.diagnosis.score_sums import CourseFound, Left, ScoreSums
from nico_selfmodel.estimation.mirrors.mirror_solution import MirrorSolution
from nico_selfmodel.estimation.mirrors.reflection_residuals import (
    independent_covariance,
    project_reflections,
    shared_factor,
    values_of,
)
from nico_selfmodel.estimation.noise import hand_noise
from nico_selfmodel.model.cameras.mirror_rig import ReflectedProjection

_FEWEST_SAMPLES = 14
"""Samples below which no change is looked for."""


def change_of_mirrors(solution: MirrorSolution, joints: tuple[str, ...]) -> Change | None:
    """Find what changed in the middle of a recording of reflections.

    Args:
        solution: The planes. Outliers take part: what contradicts all that was before is no noise.
        joints: Names of the joints that `reflections.by_angle` has.

    Returns:
        The change that explains most, or None where there is none.
    """
    reflections = solution.reflections
    known, visit = np.unique(reflections.sample, return_inverse=True)
    if len(known) < _FEWEST_SAMPLES:
        return None
    shown = project_reflections(reflections, values_of(solution.mirrors))
    planes, always, by_joint = _columns(solution, shown)
    columns = np.concatenate([planes, always, by_joint], axis=2)
    covariance = independent_covariance(reflections, shown.by_point, solution.noise)
    whitening = hand_noise.whitening_of(covariance, reflections.seen)
    miss = np.nan_to_num(reflections.pixels - shown.pixels)
    scale = 1.0 / np.maximum(np.sqrt(np.sum(columns**2, axis=(0, 1))), np.finfo(float).tiny)
    columns = np.where(reflections.seen[:, :, None], columns * scale, 0.0)
    white = whitening @ np.concatenate([miss[:, :, None], columns], axis=2)
    first, free = planes.shape[2], planes.shape[2] + always.shape[2]
    # Of each shared error one standard deviation is likely.
    prior = np.diag(scale[:free])[first:], np.zeros(free - first)
    each = np.repeat(visit, white.shape[1])
    left = Left(miss, columns, scale, visit)
    white = white.reshape(-1, white.shape[2])
    sums = ScoreSums.of(white, each, left, np.arange(free), known, prior)

    def mixed(found: CourseFound) -> bool:
        course = found.course[np.searchsorted(sums.last, reflections.sample)]
        return reflections.q is None or mixed_in_time(reflections.q, course)

    groups = [
        (mirror_words(name), list(range(3 * m, 3 * m + 3)))
        for m, name in enumerate(reflections.mirrors)
    ]
    groups += [(encoder_words(name), [free + j]) for j, name in enumerate(joints)]
    return likeliest_change(sums, groups, mixed)


def _columns(
    solution: MirrorSolution, shown: ReflectedProjection
) -> tuple[NDArray, NDArray, NDArray]:
    """Return derivatives of the pixels by planes, by what all rows share, and by joints."""
    reflections, x = solution.reflections, values_of(solution.mirrors)
    planes = np.zeros((*shown.pixels.shape, len(x)))
    for m in range(len(reflections.mirrors)):
        rows = reflections.mirror == m
        planes[rows, :, 3 * m : 3 * m + 3] = shown.by_mirror[rows]
    shared = shared_factor(reflections, x, shown.by_point)
    always = np.zeros((*shown.pixels.shape, 0)) if shared is None else shared
    return planes, always, shown.by_point @ reflections.by_angle
