"""A simulated robot that knows itself and the mirror before it exactly."""

from types import MappingProxyType

import numpy as np

from nico_selfmodel.estimation.mirrors.paint_colors import PaintColors
from nico_selfmodel.sessions.looks.known_body import KnownBody
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted
from nico_selfmodel.sessions.mirrors.knowing import PLATE, Knowing
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import touching_arm
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import imperfections_named


def knowing(seed):
    """Return it, of six joints; what it is told behind the door of the truth, it need not learn."""
    nico = RenderedNico("thesis", seed, ("fiducial",), ImageQuality(), touching_arm("fiducial"))
    truth = nico.ground_truth
    before = NicoBeforeMirrors(nico, {MIRROR: DEFAULT_MIRROR}, plate=PLATE)
    model = truth.model(mirrors={MIRROR: truth.mirror(before.views[MIRROR].X_BM)})
    with BodyImage(nico.arm, model) as image:
        paints = PaintColors.by_description(image.paints)
    body = KnownBody(
        model, (MIRROR,), MappingProxyType(truth.held), np.zeros(6), np.zeros(3), np.eye(3), paints
    )
    robot = Acquainted(seed, imperfections_named("thesis"), model, np.zeros((0, 6)))
    return Knowing(robot, body, {}, {}, {}, before)
