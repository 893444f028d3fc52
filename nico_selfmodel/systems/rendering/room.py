"""What hangs about a simulated robot and never moves."""

from collections.abc import Sequence

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform, RotationMatrix

from nico_selfmodel.systems.rendering.textured_card import textured_card
from nico_selfmodel.vision.markers.tag_card import TagCard
from nico_selfmodel.vision.printed_pattern import card_png

_LABEL = 1010
"""Of the first card in pictures of labels; the others follow."""


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
