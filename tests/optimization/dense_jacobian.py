"""The derivatives that the normal equations never write out."""

import numpy as np

from nico_selfmodel.optimization.calibration_program import _weigh


def whitened_jacobian(program, x):
    """Return the stacked derivatives of all weighted residuals and priors. Shape (m, p)."""
    rows = []
    for term in program._terms:
        r, jacobian = term.block.evaluate(x[term.columns])
        full = np.zeros((r.size, len(x)))
        weighted = jacobian * np.sqrt(_weigh(term, r)[1])
        full[:, term.columns] = weighted.reshape(len(term.columns), -1).T
        rows.append(full)
    for index, (_, sigma) in program._priors.items():
        rows.append(np.eye(1, len(x), index) / sigma)
    return np.vstack(rows)
