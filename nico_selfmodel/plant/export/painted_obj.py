"""A learned surface as a Wavefront OBJ, whose triangles are painted in a few colours."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.shape.link_shape import LinkShape

UNSEEN = (0.62, 0.64, 0.67)
"""Red, green and blue of what was never seen."""
_STEPS = 8
"""Of each of red, green and blue: an OBJ has a paint a triangle, and programs take some dozens."""


def painted_obj(shape: LinkShape, mtl: str) -> tuple[str, str]:
    """Return a surface in its link's frame, and its paints.

    Triangles of which a corner was never seen are grey. Colours stand after each vertex too, as
    MeshLab and Blender read them.

    Args:
        shape: The surface.
        mtl: Name of the file of paints, beside the OBJ.

    Returns:
        Content of the OBJ, and of the MTL.
    """
    colors = np.where(shape.seen[:, None], shape.colors, UNSEEN)
    rows = np.column_stack([shape.mesh.vertices, colors])
    lines = [f"# {shape.link}, as it was learned, in its own frame [m]", f"mtllib {mtl}"]
    lines += ["v {!r} {!r} {!r} {:.4f} {:.4f} {:.4f}".format(*row) for row in rows.tolist()]
    lines += ["vn {:.5f} {:.5f} {:.5f}".format(*row) for row in shape.mesh.normals.tolist()]
    paints, of_triangle = np.unique(_paints(shape), axis=0, return_inverse=True)
    for k, paint in enumerate(paints):
        corners = shape.mesh.triangles[of_triangle.ravel() == k] + 1
        lines += [f"usemtl {_name(paint)}"]
        lines += ["f {0}//{0} {1}//{1} {2}//{2}".format(*row) for row in corners.tolist()]
    kinds = [f"newmtl {_name(paint)}\nKd {_numbers(paint)}\nKa 0 0 0\nKs 0 0 0" for paint in paints]
    return "\n".join(lines) + "\n", "\n\n".join(kinds) + "\n"


def _paints(shape: LinkShape) -> NDArray:
    """Return the colour of each triangle, to one of a few. Shape (T, 3)."""
    seen = shape.seen[shape.mesh.triangles].all(axis=1, keepdims=True)
    mean = shape.colors[shape.mesh.triangles].mean(axis=1)
    return np.where(seen, np.round(_STEPS * mean) / _STEPS, UNSEEN)


def _name(paint: NDArray) -> str:
    if np.array_equal(paint, UNSEEN):
        return "never_seen"
    return "paint_" + "_".join(str(round(_STEPS * part)) for part in paint.tolist())


def _numbers(paint: NDArray) -> str:
    return " ".join(f"{part:g}" for part in paint.tolist())
