"""Stage 3 of the mirror test: the outer shape of links that stand still, and of those that move."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from nico_selfmodel.errors import DataError, EstimationError, ModelError
from nico_selfmodel.experiments.mirror_test.link_structure import (
    NEAR,
    SEEN,
    LinkStructure,
    judged_arm,
    posed,
    share,
)
from nico_selfmodel.geometry.solids.solid import distance_to_solids, normals_of_solids
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.mirrors.acquaintance import rendered
from nico_selfmodel.sessions.mirrors.knowing import Knowing, Refusal
from nico_selfmodel.sessions.mirrors.learned_shape import LearnedShape, carried
from nico_selfmodel.sessions.mirrors.mirror_scenario import MIRROR
from nico_selfmodel.sessions.mirrors.own_shape import WHOLE, Surfaces, learn_structure
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.shapes.own_arm import learn_arm_structure
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.stations.seen_surface import SeenSurface


@dataclass(frozen=True, eq=False)
class StructureStage:
    """All links of all robots."""

    links: tuple[LinkStructure, ...]
    """Robot by robot."""
    mirrors: int
    """In which the last robot looked at itself."""
    refusals: tuple[Refusal, ...] = ()
    """What robots say who found no surface, of head and chest or of the arm."""
    shapes: Mapping[int, BodyShape] = field(default_factory=dict)
    """Seed of a robot -> what it has learned of head and chest, which later stages may use."""
    poses: int = 0
    """In which the last robot looked at its arm."""


def run_structure(robots: Sequence[Knowing], progress: Stage | None = None) -> StructureStage:
    """Let robots learn the shape of head, chest and arm, and hold it against the true one.

    Args:
        robots: Who know themselves and two mirrors.
    """
    found: list[LinkStructure] = []
    refused: list[Refusal] = []
    shapes: dict[int, BodyShape] = {}
    mirrors = poses = 0
    for i, known in enumerate(robots):
        stage, seed = of_robot(progress, i, len(robots)), known.robot.seed
        try:
            shape, surfaces = learn_structure(known, stage)
            found += judged(known, shape, surfaces)
            shapes[seed], mirrors = shape.body, len(shape.all.standpoints)
            del shape, surfaces
        except (EstimationError, ModelError) as error:
            refused.append(Refusal(seed, f"no shape of head and chest: {error}"))
        free_memory()
        try:
            arm = learn_arm_structure(known.robot, stage)
            found += judged_arm(known.robot, arm)
            poses = arm.shape.looks
        except (DataError, EstimationError) as error:
            refused.append(Refusal(seed, f"no shape of its arm: {error}"))
    links, refusals = tuple(found), tuple(refused)
    return StructureStage(links, mirrors, refusals, MappingProxyType(shapes), poses)


def judged(known: Knowing, shape: LearnedShape, surfaces: Surfaces) -> list[LinkStructure]:
    """Hold what a robot has learned of head and chest against the truth.

    Args:
        surfaces: The true surfaces of all that stands still.
    """
    nico = rendered(known.robot)
    truth: GroundTruth = nico.ground_truth
    solids, names = posed(surfaces)
    tree = KinematicTree.from_urdf(nico.arm.urdf)
    names = np.array([carried(tree, name, WHOLE) for name in names])
    first = truth.mirror(known.before.views[MIRROR].X_BM)
    cameras = [camera.X_WC[:3, 3] for camera in truth.rig.cameras]
    centers = np.array([one.seen_from(p) for one in shape.all.standpoints for p in cameras])
    found = []
    for link, whole in shape.body.links.items():
        own = whole.seen_part
        mesh = own.mesh.moved(apply(shape.body.X_WF[link], own.mesh.vertices))
        off, which = distance_to_solids(solids, mesh.vertices)
        normals = normals_of_solids(solids, mesh.vertices)
        facing = np.einsum("cvk,vk->cv", centers[:, None] - mesh.vertices, normals)
        found.append(
            LinkStructure(
                known.robot.seed,
                link,
                mesh,
                off,
                mesh.vertices - off[:, None] * normals,
                own.sigma,
                share(names[which] != link),
                share((facing <= 0.0).all(axis=0)),
                _covered(mesh, link, surfaces, truth, first),
            )
        )
    return found


def _covered(
    mesh: TriangleMesh, link: str, surfaces: Surfaces, truth: GroundTruth, mirror: Mirror
) -> float:
    """Return which share of the places of a link seen in a mirror the learned surface passes."""
    seen = SeenSurface(surfaces, truth.rig, mirror.plane)
    places = seen.in_mirror([link], SEEN, np.random.default_rng(0)).p_FQ
    if not len(places) or not len(mesh.triangles):
        return 0.0
    return float(np.mean(mesh.distance(apply(surfaces[link][1], places)) < NEAR))
