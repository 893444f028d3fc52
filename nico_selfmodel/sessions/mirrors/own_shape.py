"""A robot learns the outer shape of its head and chest, once it knows itself and two mirrors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.sessions.camera_scenario import ArmScenario
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, learn_six_joints, rendered
from nico_selfmodel.sessions.mirrors.knowing import (
    LINKS,
    PLATE,
    Knowing,
    know_itself,
    learn_two_mirrors,
    trusting,
    with_mirrors,
)
from nico_selfmodel.sessions.mirrors.learned_shape import LearnedShape, Skeleton, learn_shape
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR, MirrorScenario
from nico_selfmodel.sessions.mirrors.shape_looks import (
    ShapeLooks,
    look_at_shape,
    tell_mirrors,
    well_told,
)
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections

WHOLE = ("head",)
"""Links that count with all that hangs on them: cameras in their cases are a part of the face."""
_DAY = 9
_HELD_OUT = 40
"""Poses by which cameras and arm are judged."""

Surfaces = Mapping[str, tuple[LinkSurface, NDArray]]
"""Link -> its true surface and its pose before the left camera."""


def learn_structure(known: Knowing, stage: Stage) -> tuple[LearnedShape, Surfaces]:
    """Let a robot look at itself in many mirrors, and learn the shape of head and chest.

    Returns:
        What it learned, and the truth of the links that stood still.

    Raises:
        EstimationError: If it finds no surface, or hardly any mirror shows its hand.
        ModelError: If hardly any pose shows its hand in a mirror.
    """
    robot = known.robot
    nico = rendered(robot, ImageQuality())
    model, told = tell_mirrors(nico, robot.model, robot.readings, known.before.plate, stage)
    seen, poses, truth = _looked(known, nico, model, told, stage)
    free_memory()  # of the cameras, whose contexts were held until now
    skeleton = Skeleton.of(KinematicTree.from_urdf(nico.arm.urdf), poses, WHOLE)
    rng = np.random.default_rng((robot.seed, 46))
    return learn_shape(seen, model, skeleton, poses, LINKS, rng, stage), truth


def _looked(
    known: Knowing,
    nico: RenderedNico,
    model: SelfModel,
    told: Mapping[str, NDArray],
    stage: Stage,
) -> tuple[ShapeLooks, Mapping[str, NDArray], Surfaces]:
    """Let a robot look at itself in two mirrors and in more that its hand has told.

    Args:
        nico: As it is rendered.
        model: Who knows all these mirrors.
        told: Where the glasses of the further ones really stand, X_BM. Shape (4, 4) each.

    Returns:
        What it saw, where its links stood before the left camera, and the true surfaces of those
        that stood still.
    """
    robot, before = known.robot, known.before
    places = {**{name: view.X_BM for name, view in before.views.items()}, **told}
    with BodyImage(nico.arm, robot.model) as image, before.station(_DAY) as station:
        known.body.pose(image)
        first = model.mirrors[MIRROR]
        looks = MirrorLooks(station, image, robot.model, first, places[MIRROR])
        poses = image.poses(known.poses[MIRROR][0])
        middles = np.array([poses[link][:3, 3] for link in LINKS])
        mirrors = well_told(model.rig, {name: model.mirrors[name] for name in places}, middles)
        seen = look_at_shape(looks, mirrors, places, list(known.poses[MIRROR]), stage)
        poses = image.poses(seen.shots[0].readings)
        moving = {image.links[number] for number in image.moving}
        truth = station.surfaces_true(looks.body.context)
    return seen, poses, {link: one for link, one in truth.items() if link not in moving}


@dataclass(frozen=True, eq=False)
class ShapeScenario:
    """What a robot has learned of itself at the end."""

    arm: ArmScenario
    """Cameras and arm."""
    mirrors: MirrorScenario
    """Two mirrors, by its hand in them."""
    shape: LearnedShape
    """Head and chest, by these and by more mirrors that were put up for them."""

    @property
    def model(self) -> SelfModel:
        """Arm, cameras and mirrors."""
        return self.mirrors.model


def learn_own_shape(
    world: Imperfections, seed: int = 0, progress: Stage | None = None
) -> ShapeScenario:
    """Let a robot make its own acquaintance as before the mirror test, and learn its shape.

    Args:
        seed: Which robot.

    Raises:
        EstimationError: If it learns no mirror, does not trust one, or finds no surface.
        ModelError: If hardly any pose shows its hand in a mirror.
    """
    stage = of_robot(progress, 0, 1)
    arm = learn_six_joints(world, seed, stage, _HELD_OUT)
    robot = Acquainted(seed, world, arm.model, arm.train.encoders)
    mirrors = learn_two_mirrors(robot, PLATE, stage)
    known = trusting(know_itself(with_mirrors(robot, mirrors), PLATE, stage))
    shape, _ = learn_structure(known, stage)
    return ShapeScenario(arm, mirrors, shape)
