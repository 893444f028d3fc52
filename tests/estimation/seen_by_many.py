"""A rig of cameras that look into a room, and boards that two of them see at a time."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import Lenses, each_lens

SIZE = (960, 720)
BOARD = np.stack([*np.meshgrid(np.arange(8), np.arange(6))], axis=-1).reshape(-1, 2) * 0.06
BOARD = np.column_stack([BOARD, np.zeros(len(BOARD))])
OUT = {"polynomial": 1.8, "fisheye": 0.7}
"""Distance of the cameras from the room's middle [m]."""


@dataclass(frozen=True, eq=False)
class Rig:
    """Cameras around a room, the first one at the world."""

    cameras: dict[str, Camera]
    """By name."""
    middle: np.ndarray
    """Of the room."""


def rig_of(
    count: int,
    rng: np.random.Generator,
    lens: Lenses = "polynomial",
    sizes: tuple[tuple[int, int], ...] = (),
) -> Rig:
    """Place cameras 35 deg apart, all looking inwards; of one size if none are given."""
    bends = {"polynomial": {"k1": -0.2, "k2": 0.05}, "fisheye": {"k1": 0.03, "k2": -0.01}}
    found = []
    sizes = sizes or (SIZE,) * count
    for k, (kind, size) in enumerate(zip(each_lens(lens, count), sizes, strict=True)):
        turn = np.radians(35.0) * k + rng.normal(0.0, 0.03)
        R = rotation_from_vector(np.array([0.0, -turn, 0.0]))
        R = R @ rotation_from_vector(rng.normal(0.0, 0.04, 3))
        X = transform(R, R @ [0.0, 0.0, -OUT[kind]])
        fx = rng.uniform(640.0, 720.0) * (0.45 if kind == "fisheye" else 1.0) * size[0] / SIZE[0]
        centre = 0.5 * np.array(size) + rng.normal(0.0, 8.0, 2)
        found.append(Camera(fx, fx * 1.003, *centre, size, lens=kind, X_WC=X, **bends[kind]))
    first = found[0].X_CW
    names = tuple(f"cam{k}" for k in range(count))
    cameras = {n: c.at(first @ c.X_WC) for n, c in zip(names, found, strict=True)}
    return Rig(cameras, apply(first, np.zeros(3)))


def seen_by_two(
    rig: Rig, rng: np.random.Generator, boards: int = 12, sigma: float = 0.2
) -> BoardViews:
    """Hold boards before each pair of neighbours, which alone take a picture of them."""
    names = tuple(rig.cameras)
    pixels, views = [], []
    for a, b in pairwise(names):
        for k in range(boards):
            seen = np.full((len(BOARD), len(names), 2), np.nan)
            while not np.isfinite(seen).any():
                X_WG = _board_before(rig, a, b, rng)
                for name in (a, b):
                    p = rig.cameras[name].project(apply(X_WG, BOARD))
                    far = np.array(rig.cameras[name].image_size) - 6.0
                    inside = np.all((p > 5.0) & (p < far), axis=1)
                    if inside.all():
                        seen[:, names.index(name)] = p + rng.normal(0.0, sigma, p.shape)
                if np.isnan(seen[:, [names.index(a), names.index(b)]]).any():
                    seen[:] = np.nan
            pixels.append(seen.reshape(len(BOARD), -1))
            views.append(f"{a}{b}{k}")
    sizes = tuple(camera.image_size for camera in rig.cameras.values())
    return BoardViews(BOARD, tuple(views), names, np.array(pixels), sizes)


def _board_before(rig: Rig, a: str, b: str, rng: np.random.Generator) -> np.ndarray:
    """Return a pose of the board in which it faces the middle of two cameras."""
    centre = 0.5 * (rig.cameras[a].X_WC[:3, 3] + rig.cameras[b].X_WC[:3, 3])
    place = rig.middle + (centre - rig.middle) * rng.uniform(0.15, 0.75)
    ahead = (rig.middle - centre) / np.linalg.norm(rig.middle - centre)
    across = np.cross([0.0, 1.0, 0.0], ahead)
    across /= np.linalg.norm(across)
    R = np.stack([across, np.cross(ahead, across), ahead], axis=1)
    R = R @ rotation_from_vector(rng.uniform(-0.45, 0.45, 3))
    place = place + R @ np.array([*rng.uniform(-0.3, 0.3, 2), 0.0])
    return transform(R, place - R @ BOARD.mean(axis=0))


def rig_error(found: dict[str, Camera], rig: Rig) -> np.ndarray:
    """Return how far each camera stands from the truth [m]."""
    return np.array(
        [np.linalg.norm((inverse(rig.cameras[n].X_WC) @ c.X_WC)[:3, 3]) for n, c in found.items()]
    )
