"""A body before mirrors, made of plain parts, so that tests can bend every one of them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel

SIZE = (640, 480)
JOINTS = ("pan", "tilt", "twist", "elbow")
RIG = StereoRig(
    Camera(381.0, 383.0, 326.0, 233.0, SIZE, k1=-0.28, k2=0.09, k3=-0.012),
    Camera(
        379.0, 380.5, 315.0, 244.0, SIZE, k1=-0.27, k2=0.085, k3=-0.011,
        X_WC=transform(rotation_from_vector([0.01, -0.03, 0.02]), [0.07, 0.001, -0.002]),
    ),
)  # fmt: skip
CHAIN = Chain(
    JOINTS,
    np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.array([[0.10, 0.15, 0.0], [0.10, 0.15, 0.0], [0.10, 0.15, 0.0], [0.10, 0.15, 0.13]]),
    ("hand",),
    np.array([[0.08, 0.10, 0.24]]),
)
"""Shoulder below and beside the cameras, forearm forward; nearly the thesis' 130 + 127 mm."""
SERVOS = ServoMap(
    JOINTS,
    offset=np.array([0.3, -0.2, 0.1, 0.4]),
    gear=np.array([1.0, 1.1, 0.9, 1.6]),
    unit=("rad",) * 4,
    counts_per_turn=np.full(4, np.nan),
    sign=np.ones(4),
)
MIRROR = Mirror.from_values([*np.radians([6.0, -9.0]), 0.48])
SECOND = Mirror.from_values([*np.radians([-15.0, 4.0]), 0.55])


def body(covariance: bool = False, **changes: object) -> SelfModel:
    """Return a body that knows its arm and cameras, and no mirror."""
    model = SelfModel(
        "body",
        DhTable.from_chain(CHAIN),
        SERVOS,
        noise_sigma=5e-4,
        cameras={"left": RIG.left, "right": RIG.right},
        pixel_sigma=0.3,
    )
    if covariance:
        free = tuple(n for n in model.parameters.names if n not in model.parameters.gauge)
        cameras = ("left.fx", "left.cx", "right.cy", "right.pose.ry", "right.pose.x")
        sigma = np.concatenate([np.full(len(free), 3e-4), [0.5, 0.5, 0.5, 5e-4, 1e-4]])
        model = replace(model, covariance=ParameterCovariance((*free, *cameras), np.diag(sigma**2)))
    return replace(model, **changes)


def poses(count: int, seed: int = 0, mirror: Mirror = MIRROR) -> NDArray:
    """Return joint angles whose reflection both cameras see well inside. Shape (count, 4)."""
    rng, found = np.random.default_rng(seed), np.zeros((0, 4))
    while len(found) < count:
        q = rng.uniform(-0.6, 0.6, (400, 4))
        shown = MirrorRig(RIG, mirror).project(CHAIN.forward(q))
        inside = ((shown > 10.0) & (shown < np.tile(SIZE, 2) - 11.0)).all(axis=1)
        found = np.concatenate([found, q[inside & (mirror.in_front_by(CHAIN.forward(q)) > 0.04)]])
    return found[:count]


def recording(
    q: NDArray,
    seen: MirrorRig | StereoRig | None = None,
    mirror: str = "glass",
    *,
    sigma: float = 0.3,
    play: float = 0.0,
    seed: int = 0,
    first: int = 1,
) -> Dataset:
    """Return what cameras saw of poses.

    Args:
        q: Joint angles. Shape (N, 4).
        seen: What projects the hand; the first mirror by default.
        mirror: Name in the data set; empty for direct views.
        sigma: Noise of a pixel coordinate [px].
        play: Half the width of the joints' noise [rad].
        seed: Of noise and play.
        first: Number of the first sample.
    """
    rng = np.random.default_rng((seed, 21))
    p = CHAIN.forward(q + rng.uniform(-1.0, 1.0, q.shape) * play)
    pixels = (seen or MirrorRig(RIG, MIRROR)).project(p)
    return Dataset(
        f"recording {seed}",
        tuple(JointInfo(name, "rad") for name in JOINTS),
        np.arange(first, first + len(q)),
        SERVOS.to_encoder(q),
        pixels=pixels + rng.normal(0.0, sigma, pixels.shape),
        mirror=np.full(len(q), mirror),
        pixel_sigma_px=sigma or None,
        image_size=SIZE,
    )


def together(*parts: Dataset) -> Dataset:
    """Return the rows of several data sets as one."""
    arrays = ("sample", "encoders", "p_WH_measured", "sweep", "marker", "pixels", "mirror")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays}
    return replace(parts[0], **joined)


def angle_deg(found: Mirror, true: Mirror = MIRROR) -> float:
    """Return the angle between two normals [deg]."""
    return float(np.degrees(found.angle_to(true)))
