"""How the light stands about a robot that has looked at its unmarked body in mirrors."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.light_turn import ShadedLook, light_turn
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.sessions.mirrors.expecting import Expecting, Unknown
from nico_selfmodel.sessions.mirrors.known_body import KnownBody, Shot
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.cropped_render import LabelledPicture
from nico_selfmodel.vision.images.image_array import bgr_of_rgba
from nico_selfmodel.vision.surprise.surprise import held_against

_TURN, _STEPS = 0.05, 2
"""By which the light is turned to see what that changes [rad], and steps of the search."""
_POINT_SIGMA, _COLOR_SIGMA = 1e-3, 0.01
"""What places [m] and colours may be off by once the body is known, as a share."""
_AREA = 40.0
"""Pixels that err alike."""


def know_light(
    image: BodyImage, known: KnownBody, shots: Sequence[Shot], noise: tuple[float, float]
) -> KnownBody:
    """Learn how the light stands about a body whose place is known.

    Args:
        image: What the robot expects; it stands and is lit as was learned afterwards.
        known: How the body stands.
        shots: Of the unmarked body.
        noise: Standard deviation of a grey level, of each camera.

    Returns:
        What is known now.

    Raises:
        ValueError: If nothing of the body is in view.
    """
    now = plain = _expected(image, known, shots)
    turned = [
        _expected(image, replace(known, light=known.light + _TURN * axis), shots)
        for axis in np.eye(3)
    ]
    for _ in range(_STEPS):
        looks = []
        for k, shot in enumerate(shots):
            mirror = known.mirror(shot.mirror)
            unknown = Unknown({}, _POINT_SIGMA, {}, _COLOR_SIGMA)
            expecting = Expecting(image, known.model.rig, mirror, noise, unknown)
            for side in range(len(SIDES)):
                changes = [_change(plain[k][side], one[k][side]) for one in turned]
                looks.append(_shaded(expecting, side, shot.pictures[side], now[k][side], changes))
        known = replace(known, light=known.light + light_turn(looks, _AREA).turn)
        now = _expected(image, known, shots)
    return known


def _expected(
    image: BodyImage, known: KnownBody, shots: Sequence[Shot]
) -> list[list[LabelledPicture]]:
    """Return what both cameras are expected to see, shot by shot."""
    known.pose(image)
    return [
        [image.expect(shot.readings, known.mirror(shot.mirror), side) for side in range(len(SIDES))]
        for shot in shots
    ]


def _change(plain: LabelledPicture, turned: LabelledPicture) -> NDArray:
    """Return what turned light changes, by a radian. BGR, shape (h, w, 3)."""
    return (bgr_of_rgba(turned.color).astype(float) - bgr_of_rgba(plain.color)) / _TURN


def _shaded(
    expecting: Expecting,
    side: int,
    picture: NDArray,
    now: LabelledPicture,
    changes: Sequence[NDArray],
) -> ShadedLook:
    """Hold one picture beside what is expected now, and what turned light changes of that."""
    judged, off, alike, noise, gain = held_against(picture, expecting.expected(side, now))
    return ShadedLook(
        off,
        gain * bgr_of_rgba(now.color)[judged].astype(float),
        gain * np.stack([one[judged] for one in changes], axis=2),
        noise + np.einsum("nii->ni", alike),
    )
