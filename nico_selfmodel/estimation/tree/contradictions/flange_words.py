"""What is said against the poses of a flange."""

import numpy as np

from nico_selfmodel.dataset.body.sensors import POSES
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_JOINT_NOISE
from nico_selfmodel.estimation.tree.guesses.flange_guess import CARRIED_NEARER, CHECK_FLANGE
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD

_LARGEST_FLANGE_PLACE = 0.05
"""A place of a flange that is off by so much is no play [m]."""
_REACH = 0.5
"""Part of a flange's usual distance from its base at which nothing is that it carries."""


def flange_misfits(calibration: TreeCalibration) -> list[str]:
    """Say which flanges' poses the data do not confirm."""
    data, found = calibration.data, dict[int, list[float]]()
    for (i, part), sigma in zip(
        calibration.train.observations.noisy_joints,
        calibration.solution.noise.joint.tolist(),
        strict=True,
    ):
        if data.joints[i].motion == FLANGE:
            found.setdefault(i, [0.0, 0.0])[part < 3] = sigma
    return [
        f"poses of flange {data.joints[i].name!r} would have to be off by {1e3 * place:.3g} mm and "
        f"{np.degrees(turn):.3g} deg: {CHECK_FLANGE}"
        for i, (place, turn) in found.items()
        if place > _LARGEST_FLANGE_PLACE or turn > LARGEST_JOINT_NOISE
    ]


def both_inverted(calibration: TreeCalibration) -> list[str]:
    """Doubt poses of a flange and of what was seen where both would fit inverted, too.

    F X = Z M and F^-1 Z = X M^-1 are one equation: what the flange carries and what stands are
    exchanged then, and only where they are tells the one from the other.
    """
    data, tree, said = calibration.data, calibration.tree, []
    if tree.motions != (FLANGE,):
        return []
    reach = float(np.median(np.linalg.norm(data.X_flange[:, 0, :3, 3], axis=1)))
    places, table = {one.name: one for one in (*tree.sensors, *tree.markers)}, data.observations
    for s, m in np.unique(np.stack([table.sensor, table.marker]), axis=1).T.tolist():
        both = (places[data.sensors[s].name], places[data.markers[m].name])
        standing, carried = sorted(both, key=lambda one: one.on)
        if data.sensors[s].kind != POSES or (standing.on, carried.on) != (WORLD, 0):
            continue
        held = float(np.linalg.norm(carried.X_LA[:3, 3]))
        stands = float(np.linalg.norm((inverse(tree.X_PJ[0]) @ standing.X_LA)[:3, 3]))
        if held > max(CARRIED_NEARER * stands, _REACH * reach):
            where, far, near = tree.joints[0], 1e3 * held, 1e3 * stands
            said.append(
                f"{carried.name!r} would be {far:.0f} mm from {where!r} that carries it, "
                f"{standing.name!r} {near:.0f} mm from its base: if it is the other way round, "
                f"poses of the flange and those that {both[0].name!r} tells are inverted"
            )
    return said
