"""What the mechanics of a simulated whole Nico leave: errors of a body that knows itself exactly.

Only for judging: where joints rest in their play, and what cameras add, is all that such a body
misses in the images.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.of_tree import link_joints_of
from nico_selfmodel.dataset.body.sensors import MarkerInfo
from nico_selfmodel.estimation.tree.tree_errors import errors_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import WORLD, WORLD_NAME, Attached, BodyTree
from nico_selfmodel.systems.rendering.station_scene import CARD
from nico_selfmodel.systems.stations.whole_nico import WholeNico
from nico_selfmodel.systems.tracking.shared_search import corner_names

_HALF = 0.4 * CARD
"""Half the side of the black square on a card [m]."""
_CORNERS = ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
"""Clockwise from the printed top left, of a card whose y points to the top."""


def mechanics_left(nico: WholeNico, data: BodyDataset) -> Mapping[str, float]:
    """Return the mean error in images that no learning takes away, by link.

    Args:
        nico: The robot as it was built.
        data: What its cameras saw, of corners of the hands' cards and of a known room.

    Returns:
        Of each link that carries something [px], by its joint.
    """
    truth, mechanics = tracked_body(nico.mechanics.tree, data.markers), nico.mechanics
    q = mechanics.expected_angles(data.readings)
    asked = replace(
        data,
        joints=link_joints_of(truth),
        readings=np.vstack([mechanics.posture(row) for row in q]),
        flanges=None,
        approach=None,
    )
    left = errors_of(truth, asked)
    distance, on = left.by_row(), np.array([marker.on for marker in truth.markers])
    link = on[left.observations.data.observations.marker]
    return {
        truth.joints[i]: float(np.nanmean(distance[link == i]))
        for i in np.unique(link[link != WORLD]).tolist()
    }


def tracked_body(tree: BodyTree, infos: Sequence[MarkerInfo]) -> BodyTree:
    """Return a body that is read in its joints' angles, with the markers that its cameras look for.

    Args:
        tree: The body as built, with the hands' cards.
        infos: Corners of these cards, and markers of known place in the room.
    """
    corners = {
        own: _corner(marker, own, k)
        for marker in tree.markers
        for k, own in enumerate(corner_names(marker.name))
    }
    markers = tuple(_known(info) or corners[info.name] for info in infos)
    return replace(tree.with_markers(markers), gear=np.ones(len(tree.joints)))


def _corner(card: Attached, name: str, k: int) -> Attached:
    x, y = _HALF * _CORNERS[k][0], _HALF * _CORNERS[k][1]
    return Attached(name, card.on, card.X_LA @ transform(np.eye(3), np.array([x, y, 0.0])))


def _known(info: MarkerInfo) -> Attached | None:
    if info.on != WORLD_NAME or info.xyz is None:
        return None
    return Attached(info.name, WORLD, transform(np.eye(3), np.array(info.xyz)), oriented=False)
