"""The outer surface of a link as it was learned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh


@dataclass(frozen=True, eq=False)
class LinkShape:
    """What of a link's surface was seen; where it ends, nothing is known of it."""

    link: str
    """Name of the link."""
    mesh: TriangleMesh
    """In the link's frame."""
    sigma: NDArray
    """Of each vertex along its normal [m]. Shape (V,)."""
    colors: NDArray
    """Red, green and blue of each vertex, of 1, in the light in which it was seen. (V, 3)."""
    looks: NDArray
    """Pictures in which each vertex was seen. Shape (V,)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the arrays read-only."""
        size = len(self.mesh.vertices)
        for name, shape in (("sigma", (size,)), ("colors", (size, 3)), ("looks", (size,))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))
        if size and not (self.sigma > 0.0).all():
            raise ValueError(f"sigma must be positive, got {np.min(self.sigma):g} m")
