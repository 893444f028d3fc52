"""Whether a flange's poses and a size that was told contradict each other, beside their noise.

What a target of another size does to places goes with the poses, and looks like errors of the
flange, its own or shared by poses that are alike. So noise is asked for anew with the logarithm e
of the size free: with sigma its standard deviation in that noise, e / sigma is t of nu freedoms
where the size is right, as rare as chi square of one,

    ((8 nu + 1) / (8 nu + 3))^2 nu log(1 + (e / sigma)^2 / nu)

(Wallace 1959). Where poses that are alike share errors all the same, these may be what it is.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.noise.alike_noise import likeliest_alike
from nico_selfmodel.estimation.tree.noise.likeliest_noise import likeliest_noise
from nico_selfmodel.estimation.tree.noise.noise_evidence import asked_for
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.model.tree.body_tree import FLANGE
from nico_selfmodel.optimization.chi_square import chi_square_tail

_PLACE = 3
"""Numbers of a sight that tell the noise of places."""
_TAKEN = 7
"""What fitting takes of them: where the target and the sensor are, and the size."""

_CONTROLLER = 0.01
"""Part of what a flange moved by which its controller may be off in poses alike."""


@dataclass(frozen=True, eq=False)
class SizeBesideNoise:
    """What a recording says of a size with noise of its own."""

    gain: float
    """Chi square of one freedom that is as rare."""
    value: float
    """Where the logarithm would go."""
    sigma: float
    """Standard deviation of that."""

    @classmethod
    def of(
        cls,
        problem: TreeProblem,
        solution: TreeSolution,
        column: NDArray,
        sights: int,
        chance: float,
    ) -> "SizeBesideNoise | None":
        """Ask for it.

        Args:
            problem: What was solved.
            solution: Where it ended.
            column: Derivatives of the residuals by the logarithm. Shape (R,).
            sights: How often the target was seen.
            chance: How often noise alone may do as much.

        Returns:
            None where no flange takes part, noise or a controller does as much, or poses share
            errors besides.
        """
        seen, freedoms = problem.observations, _PLACE * sights - _TAKEN
        flange = any(seen.data.joints[i].motion == FLANGE for i, _ in seen.noisy_joints)
        if not flange or not solution.variances_known or freedoms < 1 or not column.any():
            return None
        evidence = problem.evidence_at(solution)
        linear = replace(evidence.linear, J=np.vstack([evidence.linear.J, column]))
        known = np.append(evidence.information, 0.0)
        beside = replace(evidence, linear=linear, information=known)
        noise = likeliest_noise(beside, replace(solution.noise, alike=()))
        values, variances = asked_for(beside, noise)
        squared = float(values[-1] ** 2 / variances[-1])
        part = ((8 * freedoms + 1) / (8 * freedoms + 3)) ** 2
        gain = part * freedoms * float(np.log1p(squared / freedoms))
        if abs(values[-1]) < _CONTROLLER or chi_square_tail(gain, 1) > chance:
            return None
        if likeliest_alike(beside, noise) is not None:
            return None
        return cls(gain, float(values[-1]), float(np.sqrt(variances[-1])))
