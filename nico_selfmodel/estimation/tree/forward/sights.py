"""What the sensors of a run show of a body."""

import numpy as np

from nico_selfmodel.dataset.body.sensors import CAMERA, CONTACT, DISTANCE, PLANE, POINTS
from nico_selfmodel.estimation.tree.forward.sensor_models import (
    Shown,
    shown_bearings,
    shown_distances,
    shown_heights,
    shown_pixels,
    shown_points,
    shown_poses,
)
from nico_selfmodel.estimation.tree.forward.sensor_run import SensorRun, Sight
from nico_selfmodel.estimation.tree.tree_observations import BEARING
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion


def sight_of(tree: BodyTree, motion: TreeMotion, run: SensorRun) -> Sight:
    """Return what sensors show.

    Args:
        motion: It at the samples.
        run: What the sensors measured, N observations.
    """
    frames = tree.X_attached
    p_WM, p_WS = run.seen.places(motion, frames), run.seeing.places(motion, frames)
    R_SW = np.swapaxes(run.seeing.orientations(motion, frames), 1, 2)
    apparent = reflect(tree.mirror(run.mirror).plane, p_WM) if run.mirror else p_WM
    p_SM = (R_SW @ (apparent - p_WS)[:, :, None])[:, :, 0]
    if run.kind in (CAMERA, BEARING):
        show = shown_pixels if run.kind == CAMERA else shown_bearings
        each = zip(run.own, run.parts, strict=True)
        parts = [show(p_SM[own], tree.lenses[part.name], part.measured) for own, part in each]
        return Sight(Shown.together(parts), tuple(parts), R_SW, p_WM, p_WS)
    if run.kind == POINTS:
        shown = shown_points(p_SM, run.measured)
    elif run.kind == DISTANCE:
        shown = shown_distances(p_SM, run.measured)
    elif run.kind == CONTACT:
        apart = np.zeros((len(p_SM), 1))
        for own, part in zip(run.own, run.parts, strict=True):
            apart[own] = tree.contacts[part.name]
        shown = shown_distances(p_SM, apart)
    elif run.kind == PLANE:
        shown = shown_heights(p_SM)
    else:
        shown = shown_poses(p_SM, R_SW @ run.seen.orientations(motion, frames), run.measured)
    return Sight(shown, (), R_SW, p_WM, p_WS)
