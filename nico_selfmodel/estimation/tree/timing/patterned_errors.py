"""Joints of a body whose noise is backlash, or an eccentric gear or encoder, that nobody told."""

import numpy as np

from nico_selfmodel.estimation.diagnosis.pattern_taken_for_noise import pattern_taken_for_noise
from nico_selfmodel.estimation.diagnosis.systematic_residuals import FAR, tell_sides
from nico_selfmodel.estimation.results.calibration_result import CAUSE, WARNING, Finding
from nico_selfmodel.estimation.tree.timing.moved_meanwhile import doubted_joints
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.model.tree.body_tree import REVOLUTE


def patterned_findings(problem: TreeProblem, solution: TreeSolution) -> list[Finding]:
    """Say what most of the noise is of joints that turn and are read worse than others.

    Args:
        problem: What was solved.
        solution: Where it ended.
    """
    seen, found = problem.observations, list[Finding]()
    data = seen.data
    for k, at, errors in doubted_joints(problem, solution):
        i = seen.noisy_joints[k][0]
        joint, told = data.joints[i], bool(data.si_approach[:, i].any())
        if joint.motion != REVOLUTE:
            continue
        pattern = pattern_taken_for_noise(errors, data.si_readings[at, i], data.sample[at])
        if pattern is None or (pattern.side and told):
            continue
        half = f"{np.degrees(pattern.size):.2g} deg"
        text = (
            f"errors of joint {joint.name!r} depend on the side from which it came (backlash, half "
            f"width {half}): {tell_sides(joint.name)}"
            if pattern.side
            else f"errors of joint {joint.name!r} depend on its angle (eccentric gear or encoder, "
            f"{half}): center it, or record more poses, evenly over its range"
        )
        found.append(Finding(CAUSE if pattern.size > FAR else WARNING, text))
    return found
