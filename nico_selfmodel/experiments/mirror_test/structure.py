"""Stage 3 of the mirror test: the outer shape of head and chest, learned in mirrors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids, normals_of_solids
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
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.stations.seen_surface import SeenSurface

NEAR = 5e-3
"""What is seen in a mirror is claimed if the learned surface passes so near [m]."""
_SEEN = 300
"""Places of head and chest that are seen in the mirror and looked for in the learned surface."""


@dataclass(frozen=True, eq=False)
class LinkStructure:
    """The learned surface of one link beside the true one, before the left camera."""

    robot: int
    """Seed of the robot."""
    link: str
    """Name of the link."""
    mesh: TriangleMesh
    """As learned, in the left camera's frame."""
    off: NDArray
    """How far each vertex is outside of the true body [m]. Shape (V,)."""
    p_LT: NDArray
    """Where the true body is next to each vertex, to first order [m]. Shape (V, 3)."""
    sigma: NDArray
    """What the robot says it may be off by [m]. Shape (V,)."""
    strange: float
    """Share of vertices that are nearest to another link."""
    unseen: float
    """Share of vertices of which no camera saw the outside in any mirror."""
    covered: float
    """Share of the places seen in the first mirror that the learned surface passes."""


@dataclass(frozen=True, eq=False)
class StructureStage:
    """All links of all robots."""

    links: tuple[LinkStructure, ...]
    """Robot by robot."""
    mirrors: int
    """In which the last robot looked at itself."""
    refusals: tuple[Refusal, ...] = ()
    """What robots say who found no surface."""
    shapes: Mapping[int, BodyShape] = field(default_factory=dict)
    """Seed of a robot -> what it has learned, which later stages may use."""


def run_structure(robots: Sequence[Knowing], progress: Stage | None = None) -> StructureStage:
    """Let robots learn the shape of head and chest, and hold it against the true one.

    Args:
        robots: Who know themselves and two mirrors.
    """
    found: list[LinkStructure] = []
    refused: list[Refusal] = []
    shapes: dict[int, BodyShape] = {}
    count = 0
    for i, known in enumerate(robots):
        try:
            shape, surfaces = learn_structure(known, of_robot(progress, i, len(robots)))
        except (EstimationError, ModelError) as error:
            refused.append(Refusal(known.robot.seed, str(error)))
            continue
        found += judged(known, shape, surfaces)
        shapes[known.robot.seed] = shape.body
        count = len(shape.all.standpoints)
    return StructureStage(tuple(found), count, tuple(refused), MappingProxyType(shapes))


def judged(known: Knowing, shape: LearnedShape, surfaces: Surfaces) -> list[LinkStructure]:
    """Hold what a robot has learned against the truth.

    Args:
        surfaces: The true surfaces of all that stands still.
    """
    nico = rendered(known.robot)
    truth: GroundTruth = nico.ground_truth
    solids, names = _posed(surfaces)
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
                _share(names[which] != link),
                _share((facing <= 0.0).all(axis=0)),
                _covered(mesh, link, surfaces, truth, first),
            )
        )
    return found


def _share(holds: NDArray) -> float:
    """Return the share of vertices of which something holds; 0 where there is none."""
    return float(np.mean(holds)) if len(holds) else 0.0


def _posed(surfaces: Surfaces) -> tuple[list[Solid], NDArray]:
    """Return all solids before the left camera, and the link of each."""
    solids = [
        Solid(one.kind, one.size, X_LF @ one.X_FS)
        for surface, X_LF in surfaces.values()
        for one in surface.solids
    ]
    names = [link for link, (surface, _) in surfaces.items() for _ in surface.solids]
    return solids, np.array(names)


def _covered(
    mesh: TriangleMesh, link: str, surfaces: Surfaces, truth: GroundTruth, mirror: Mirror
) -> float:
    """Return which share of the places of a link seen in a mirror the learned surface passes."""
    seen = SeenSurface(surfaces, truth.rig, mirror.plane)
    places = seen.in_mirror_only([link], _SEEN, np.random.default_rng(0)).p_FQ
    if not len(places) or not len(mesh.triangles):
        return 0.0
    return float(np.mean(mesh.distance(apply(surfaces[link][1], places)) < NEAR))
