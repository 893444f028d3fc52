"""Whether a glass before a head that moves is flat.

A flat glass shows a point p at p' = S p - 2 d n to every camera, wherever the head has it. A bent
one shows it elsewhere, to each camera in its own way: p'' = p' + w x (p' - o) + v, with six numbers
a camera, follows that as free reflected cameras do before cameras that stand still. One plane is
among them; what they fit better is held against chance (`estimation.diagnosis.flatness`).
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.flatness import STEADYING, Flatness, flatness_by
from nico_selfmodel.estimation.tree.forward.sights import sight_of
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import skew


def flatness_of_glasses(
    problem: TreeProblem, solution: TreeSolution, planes: NDArray, may_err: NDArray
) -> Mapping[str, Flatness | None]:
    """Test whether each mirror of a recording is flat.

    Args:
        problem: The body with its mirrors; all that may err is free.
        solution: Where its planes fit best.
        planes: Numbers of the planes' parameters among what is free. Shape (p,).
        may_err: Ways in which what is free may err, each as large as it is expected to be: their
            coordinates are N(0, 1). Shape (free, k).

    Returns:
        The tests by mirror; None where there are too few reflections.
    """
    out: dict[str, Flatness | None] = {}
    for mirror in problem.observations.data.mirrors:
        free = _by_free_cameras(problem.residuals, solution.values, mirror)
        U, white = problem.whitened_at(solution, free)
        own, count = U.shape[1] - free.shape[1], free.shape[1]
        if int((free != 0.0).any(axis=1).sum()) - count < STEADYING:
            out[mirror] = None
            continue
        by_plane, by_cameras, errors = U[:, planes], U[:, own:], U[:, :own] @ may_err
        # Errors are known beforehand to be about nothing: a row of its own for each.
        known = np.eye(errors.shape[1])
        free_cameras = np.hstack([by_plane, by_cameras])
        out[mirror] = flatness_by(
            np.append(white, np.zeros(len(known))),
            _above(by_plane, errors, known),
            _above(free_cameras, errors, known),
            count - 3,
            len(white) - count,
        )
    return out


def _above(rows: NDArray, errors: NDArray, known: NDArray) -> NDArray:
    return np.block([[rows, errors], [np.zeros((len(known), rows.shape[1])), known]])


def _by_free_cameras(residuals: TreeResiduals, values: NDArray, mirror: str) -> NDArray:
    """Return derivatives of all residuals by what each camera sees elsewhere in a glass.

    By w and v of each of the C cameras that saw something in it. Shape (R, 6 C).
    """
    tree = residuals.parameters.tree_of(values)
    motion, plane = residuals.motion(tree), tree.mirror(mirror).plane
    seeing = [rows for rows in residuals.observations.sensors if rows.mirror == mirror]
    cameras = sorted({rows.sensor for rows in seeing})
    out = np.zeros((len(residuals.observations.row), 6 * len(cameras)))
    for rows in seeing:
        c = cameras.index(rows.sensor)
        sight = sight_of(tree, motion, residuals.run_of(rows))
        shift, p_WV = sight.shown.by_point @ sight.R_SW, reflect(plane, sight.p_WM)
        turn = -shift @ skew(p_WV - p_WV.mean(axis=0))
        both = np.concatenate([turn, shift], axis=2)
        out[rows.scalars, 6 * c : 6 * c + 6] = both.reshape(-1, 6)
    return out
