"""A small learned shape, half of it seen, without a robot that looks."""

import numpy as np

from nico_selfmodel.geometry.surface_nets import surface_nets
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.geometry.voxel_grid import VoxelGrid
from nico_selfmodel.model.shape.link_shape import BodyShape, LinkShape


def ball_shape(link, radius=0.06, center=(0.0, 0.0, 0.0)):
    """Return a ball of which the half with x > 0 was seen, red where z > 0 and blue below."""
    grid = VoxelGrid.about(np.zeros((1, 3)), 1.3 * radius, radius / 4.0)
    field = np.linalg.norm(grid.points, axis=1) - radius
    mesh = surface_nets(grid, field.reshape(grid.shape))
    x, _, z = mesh.vertices.T
    colors = np.where(z[:, None] > 0.0, [0.8, 0.2, 0.1], [0.1, 0.3, 0.9])
    seen = x > 0.0
    return LinkShape(
        link,
        mesh.moved(mesh.vertices + center),
        np.full(len(x), 1.7e-3),
        colors,
        np.where(seen, 14, 3),
        seen,
    )


def ball_body(*links):
    """Return such a ball for each link, 0.2 m beside each other before the camera."""
    poses = {
        link: transform(np.diag([-1.0, -1.0, 1.0]), [0.2 * k, 0.1, 0.5])
        for k, link in enumerate(links)
    }
    return BodyShape({link: ball_shape(link) for link in links}, poses)
