"""The learned surface of one link beside the true one, and links of the arm judged by that.

A shape of a link that the arm moves is judged in its own frame. Where that is the learned arm
tells, in each look anew, and what joints leave to chance is no part of a shape: the frame counts
that is the true one's in the mean of all looks.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids, normals_of_solids
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.mirrors.own_shape import Surfaces
from nico_selfmodel.sessions.rendered_nico import FIDUCIAL
from nico_selfmodel.sessions.shapes.own_arm import ArmStructure
from nico_selfmodel.sessions.shapes.rigid_body import moving_with
from nico_selfmodel.systems.looking import MARKER_FRAMES
from nico_selfmodel.systems.rendering.station_scene import CARD
from nico_selfmodel.systems.stations.seen_surface import SeenSurface

NEAR = 5e-3
"""What is seen is claimed if the learned surface passes so near [m]."""
SEEN = 300
"""Places of a link that are seen, and looked for in the learned surface."""
_LOOKED = 5
"""Looks whose places are looked for in the learned surface."""
_THICK = 4.5e-3
"""Of the printed card and the described plate below it [m]."""


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
    """Share of vertices of which no camera saw the outside in any look."""
    covered: float
    """Share of the places seen, in the first mirror or directly, that the surface passes."""


def share(holds: NDArray) -> float:
    """Return the share of vertices of which something holds; 0 where there is none."""
    return float(np.mean(holds)) if len(holds) else 0.0


def posed(surfaces: Surfaces, X_FL: NDArray | None = None) -> tuple[list[Solid], NDArray]:
    """Return all solids before the left camera, and the link of each.

    Args:
        X_FL: Pose of the left camera in another frame, if they are wanted there. Shape (4, 4).
    """
    X_FL = np.eye(4) if X_FL is None else X_FL
    solids = [
        Solid(one.kind, one.size, X_FL @ X_LF @ one.X_FS)
        for surface, X_LF in surfaces.values()
        for one in surface.solids
    ]
    names = [link for link, (surface, _) in surfaces.items() for _ in surface.solids]
    return solids, np.array(names)


def judged_arm(robot: Acquainted, found: ArmStructure) -> list[LinkStructure]:
    """Hold what a robot has learned of its arm's shape against the truth.

    Returns:
        A link each, where it stood in the first look.
    """
    nico = rendered(robot)
    tree, rig = KinematicTree.from_urdf(nico.arm.urdf), nico.ground_truth.rig
    whole = replace(found, surfaces=tuple(with_card(tree, one) for one in found.surfaces))
    return [
        judged_link(robot.seed, link, moving_with(tree, nico.arm.joints, link), whole, rig)
        for link in found.shape.body.links
    ]


def with_card(tree: KinematicTree, surfaces: Surfaces) -> Surfaces:
    """Return the surfaces with the hand's printed card, which is drawn on what is described."""
    joint = tree.joint_above[MARKER_FRAMES[FIDUCIAL]]
    link = joint.parent_body().name()
    X_FM = joint.frame_on_parent().GetFixedPoseInBodyFrame().GetAsMatrix4()
    surface, X_LF = surfaces[link]
    below = transform(np.eye(3), [0.0, 0.0, -0.5 * _THICK])
    card = Solid("box", (CARD, CARD, _THICK), X_FM @ below)
    colors = np.vstack([surface.colors, np.ones(3)])
    solids = (*surface.solids, card)
    return {**surfaces, link: (replace(surface, solids=solids, colors=colors), X_LF)}


def judged_link(
    robot: int, link: str, together: frozenset[str], found: ArmStructure, rig: StereoRig
) -> LinkStructure:
    """Judge one link of the arm.

    Args:
        robot: Seed of the robot.
        together: Links that move with it, which count to it.
        rig: The true cameras.
    """
    own = found.shape.body.links[link].seen_part
    X_LF = np.array([surfaces[link][1] for surfaces in found.surfaces])
    X_FL = np.array([inverse(X) for X in X_LF])
    mesh = own.mesh.moved(apply(meant(X_FL, found.shape.poses[link]), own.mesh.vertices))
    solids, names = posed(found.surfaces[0], X_FL[0])
    carried = np.isin(names, sorted(together))
    off, _ = distance_to_solids(_of(solids, carried), mesh.vertices)
    normals = normals_of_solids(_of(solids, carried), mesh.vertices)
    centers = np.array([apply(X, camera.X_WC[:3, 3]) for X in X_FL for camera in rig.cameras])
    facing = np.einsum("cvk,vk->cv", centers[:, None] - mesh.vertices, normals)
    nearest = distance_to_solids(solids, mesh.vertices)[1]
    return LinkStructure(
        robot,
        link,
        mesh.moved(apply(X_LF[0], mesh.vertices)),
        off,
        apply(X_LF[0], mesh.vertices - off[:, None] * normals),
        own.sigma,
        share(~carried[nearest]),
        share((facing <= 0.0).all(axis=0)),
        _covered(mesh, link, together, found.surfaces, rig),
    )


def _of(solids: Sequence[Solid], which: NDArray) -> list[Solid]:
    return [solid for solid, own in zip(solids, which, strict=True) if own]


def meant(X_FL: NDArray, X_LG: NDArray) -> NDArray:
    """Return where learned frames G are in the true ones F, in the mean. Shape (K, 4, 4) each.

    Returns:
        Mean place, and the rotation nearest to the mean of all (Moakher 2002). Shape (4, 4).
    """
    mean = (X_FL @ X_LG).mean(axis=0)
    return transform(nearest_rotation(mean[:3, :3]), mean[:3, 3])


def _covered(
    mesh: TriangleMesh,
    link: str,
    together: frozenset[str],
    looks: Sequence[Surfaces],
    rig: StereoRig,
) -> float:
    """Return which share of the places of a link that are seen the learned surface passes.

    Args:
        mesh: In the link's true frame.
        looks: All true surfaces in each.
    """
    if not len(mesh.triangles):
        return 0.0
    rng, far = np.random.default_rng(0), []
    for surfaces in looks[:: max(1, len(looks) // _LOOKED)]:
        seen = SeenSurface(surfaces, rig, None).directly(sorted(together), SEEN // _LOOKED, rng)
        X_FL = inverse(surfaces[link][1])
        for own, p_OQ in zip(seen.links, seen.p_FQ, strict=True):
            far.append(apply(X_FL @ surfaces[own][1], p_OQ[None]))
    return share(mesh.distance(np.concatenate(far)) < NEAR) if far else 0.0
