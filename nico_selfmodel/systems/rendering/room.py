"""What hangs about a simulated robot and never moves."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RotationMatrix

from nico_selfmodel.systems.rendering.textured_card import textured_card
from nico_selfmodel.vision.markers.tag_card import TagCard
from nico_selfmodel.vision.printed_pattern import card_png, wallpaper_png

_LABEL = 1010
"""Of the first card in pictures of labels; the others follow."""
_WALLS, _HEIGHT, _BEHIND, _BESIDE = 1006, 5.0, 1.3, 2.0
"""Of papered walls: the first one's label, how high they are, how far behind the robot's base one
stands, and how far beside it the two others [m]."""


def hang_cards(scene_graph: SceneGraph, cards: Sequence[TagCard]) -> None:
    """Hang cards of markers where they belong.

    Args:
        scene_graph: Where the robot is drawn; its world is the cards' W.
    """
    if not cards:
        return
    source = scene_graph.RegisterSource("room")
    for k, card in enumerate(cards):
        # Whoever looks at the card looks along -z of its frame.
        X_KC = RigidTransform(RotationMatrix.MakeXRotation(np.pi), card.middle)
        X_WC = RigidTransform(pose=card.X_WK) @ X_KC
        printed = textured_card(f"card{k}", card_png(card), card.size, X_WC, _LABEL + k)
        scene_graph.RegisterAnchoredGeometry(source, printed)


def paper_walls(scene_graph: SceneGraph) -> None:
    """Put papered walls behind the robot and on both sides up to it, which it sees in mirrors.

    Args:
        scene_graph: Where the robot is drawn; it looks along x of its world.
    """
    source = scene_graph.RegisterSource("walls")
    half = 0.5 * _BEHIND
    walls = [
        ((-1.0, 0.0), (-_BEHIND, 0.0), 2.0 * _BESIDE),
        ((0.0, 1.0), (-half, _BESIDE), _BEHIND),
        ((0.0, -1.0), (-half, -_BESIDE), _BEHIND),
    ]
    for k, (way, middle, width) in enumerate(walls):
        # Whoever looks at a wall looks along z of its frame, and has y down.
        z, y = np.array([*way, 0.0]), np.array([0.0, 0.0, -1.0])
        X_WC = RigidTransform(
            RotationMatrix(np.stack([np.cross(y, z), y, z], axis=1)), [*middle, 0.0]
        )
        size, name = (width, _HEIGHT), f"wall{k}"
        paper = textured_card(name, wallpaper_png(size, k), size, X_WC, _WALLS + k)
        scene_graph.RegisterAnchoredGeometry(source, paper)
