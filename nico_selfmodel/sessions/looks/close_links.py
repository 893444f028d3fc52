"""Where links lie so close together that it is not known which of them is seen."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.systems.rendering.cropped_render import LabelledPicture


def near_other_links(
    rig: MirrorRig,
    side: int,
    seen: LabelledPicture,
    where: NDArray,
    links: Mapping[int, tuple[LinkSurface, NDArray]],
    place_sigma: Callable[[int], float],
) -> NDArray:
    """Return where a reflected body may show another link than the one that is expected.

    A place of link i shows link j instead where both are nearer together than they are known:

        |d_j(p)| < sqrt(s_i^2 + s_j^2)

    with d_j the distance from the surface of j, and s what places of a link are not known by. (In
    robot 1941 a strip of the forearm's shell was expected 0.4 mm before the dark yoke of the elbow
    that hides it.)

    Args:
        rig: Cameras and mirror.
        side: Which camera, 0 or 1.
        seen: What is expected.
        where: Pixels that are asked for, all of the reflected body. Shape (h, w).
        links: Number of each link that may be seen -> its surface, and its pose in the world.
        place_sigma: s of the link of a number, each coordinate [m].

    Returns:
        Truth values. Shape (h, w).
    """
    rows, columns = np.nonzero(where)
    camera = rig.rig.cameras[side]
    behind = camera.at_depth(np.stack([columns, rows], axis=1), seen.depth[rows, columns])
    p_WQ, shown = reflect(rig.plane, behind), seen.labels[rows, columns]
    own = np.zeros(len(rows))
    for number in np.unique(shown).tolist():
        own[shown == number] = place_sigma(number)
    near = np.zeros(len(rows), dtype=bool)
    for number, (surface, X_WF) in links.items():
        distance = np.abs(surface.distance(apply(inverse(X_WF), p_WQ)))
        near |= (shown != number) & (distance < np.hypot(own, place_sigma(number)))
    found = np.zeros(where.shape, dtype=bool)
    found[rows, columns] = near
    return found
