"""What a change of a known body looks like: the body now, as it was, and how its hand moved."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.monitoring.update_evaluation import HeldAgainst, UpdateEvaluation
from nico_selfmodel.estimation.observations.pixel_observations import columns_of
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.arm_items import arm_items
from nico_selfmodel.viz.scene.arm_shape import arm_length
from nico_selfmodel.viz.scene.body_scene import middle_row, standing, with_body
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Needles
from nico_selfmodel.viz.scene.surroundings import upright

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_DOT = 0.003
_ENLARGED = 10.0
"""Residuals are drawn this many times as long."""
_SLIMMER = 0.9
"""The body as it was is drawn so much thinner: where nothing moved it is not seen."""
_WAS, _MOVED = palette.rgba(palette.MUTED, 0.5), palette.rgba(palette.CROSS_VALIDATION)
_SEEN = palette.rgba(palette.MUTED, 0.7)


def update_scene(evaluation: UpdateEvaluation, robot: "ArmDescription | None" = None) -> Scene:
    """Describe a change as a scene; z is up.

    Args:
        evaluation: The body before and after, and its observations.
        robot: The robot that the arm belongs to, to be drawn around it.

    Returns:
        The arm at the pose nearest to the middle of the observations as it is and, thinner, as it
        was; cameras where there are any; the hand at every pose, where it was thought before, and
        tenfold where it was seen.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    X_SW = upright(evaluation.after, robot)
    body, earlier = (standing(m, X_SW) for m in (evaluation.after, evaluation.before))
    reading, unit = _middle_reading(evaluation), arm_length(body.chain)
    q, q_before = (model.servos.to_joint(reading) for model in (body, earlier))
    before, after = evaluation.held["train"]
    items = [*_ghost(earlier, q_before, unit), *_hands(before, after, X_SW)]
    return with_body(body, q, items, X_SW, after.p_WH_predicted, _legend(), robot)


def _middle_reading(evaluation: UpdateEvaluation) -> NDArray:
    """Return the readings of the pose nearest to the middle [encoder units]. Shape (n,)."""
    data = columns_of(evaluation.after, evaluation.train)
    q = evaluation.after.servos.to_joint(data.encoders)
    return data.encoders[middle_row(q)]


def _ghost(model: SelfModel, q: NDArray, unit: float) -> list[Item]:
    """Return the links of the body as it was."""
    drawn = arm_items(model, q, _SLIMMER * unit)
    return [
        replace(item, path=f"before/{item.path}", color=_WAS)
        for item in drawn
        if item.path.startswith("arm/")
    ]


def _hands(before: HeldAgainst, after: HeldAgainst, X_SW: NDArray) -> list[Item]:
    """Return the hand at every pose: now, before, and as it was seen."""
    was, now, seen = (
        apply(X_SW, p) for p in (before.p_WH_predicted, after.p_WH_predicted, after.p_WH_seen)
    )
    dots = Markers(path="hand/now", color=palette.rgba(palette.HAND), centers=now, radius=_DOT)
    moved = np.linalg.norm(now - was, axis=1) > 0.0
    both = np.isfinite(seen).all(axis=1)
    tenfold = now + _ENLARGED * (seen - now)
    return [
        dots,
        *_needles("hand/moved", _MOVED, was[moved], now[moved], 0.3 * _DOT),
        *_needles("hand/residuals_tenfold", _SEEN, now[both], tenfold[both], 0.25 * _DOT),
    ]


def _needles(
    path: str, color: palette.Rgba, starts: NDArray, ends: NDArray, radius: float
) -> list[Item]:
    """Return needles; nothing where there are none."""
    if not len(starts):
        return []
    return [Needles(path=path, color=color, starts=starts, ends=ends, radius=radius)]


def _legend() -> list[LegendEntry]:
    return [
        LegendEntry("the arm as it was, thinner", _WAS),
        LegendEntry("hand as it is known now", palette.rgba(palette.HAND)),
        LegendEntry("from where it was expected before", _MOVED),
        LegendEntry("where it was seen, tenfold", _SEEN),
    ]
