"""Arms drawn at random, with axes in every special position."""

import numpy as np
import pytest
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_about, tangent_basis
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel


def _unit(rng: np.random.Generator) -> NDArray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _next_axis(kind: str, d: NDArray, c: NDArray, rng: np.random.Generator) -> tuple:
    """Return direction and point of an axis that stands to (d, c) as `kind` says."""
    aside = tangent_basis(d) @ rng.normal(0.0, 0.3, 2)
    along = rng.normal(0.0, 0.3) * d
    if kind == "near-parallel":
        angle = 10.0 ** rng.uniform(-9.0, -0.5)
        side = rng.choice([-1.0, 1.0])
        hinge = np.cross(d, _unit(rng))
        hinge /= np.linalg.norm(hinge)
        return side * rotation_about(hinge, angle) @ d, c + along + aside
    if kind in ("parallel", "anti-parallel"):
        return (d if kind == "parallel" else -d), c + along + aside
    if kind == "coaxial":
        return d * rng.choice([-1.0, 1.0]), c + along
    if kind == "near-coaxial":
        gap = 10.0 ** rng.uniform(-11.0, -3.0)
        return d, c + along + gap * aside / np.linalg.norm(aside)
    return _unit(rng), c + along + (0.0 if kind == "intersecting" else aside)


@pytest.fixture(scope="session")
def make_chain():
    """Return a function: kinds of the joints after the first, seed, markers -> a chain."""

    def make(kinds: list[str], seed: int = 0, markers: int = 1, hand_on_axis: bool = False):
        rng = np.random.default_rng(seed)
        directions, points = [_unit(rng)], [rng.normal(0.0, 0.3, 3)]
        for kind in kinds:
            d, c = _next_axis(kind, directions[-1], points[-1], rng)
            directions.append(d / np.linalg.norm(d))
            points.append(c)
        hands = points[-1] + rng.normal(0.0, 0.2, (markers, 3))
        if hand_on_axis:
            hands[0] = points[-1] + 0.1 * directions[-1]
        joints = tuple(f"joint_{i}" for i in range(len(points)))
        names = tuple(f"marker_{i}" for i in range(markers))
        return Chain(joints, np.stack(directions), np.stack(points), names, hands)

    return make


@pytest.fixture(scope="session")
def make_servos():
    """Return a function: joint names, seed -> servos in all units."""

    def make(joints: tuple[str, ...], seed: int = 0) -> ServoMap:
        rng, n = np.random.default_rng(seed), len(joints)
        unit = tuple(("counts", "rad", "deg")[i % 3] for i in range(n))
        return ServoMap(
            joints,
            offset=rng.uniform(-1.0, 1.0, n),
            gear=rng.uniform(0.5, 2.0, n),
            unit=unit,
            counts_per_turn=np.where(
                np.array(unit) == "counts", rng.integers(500, 5000, n), np.nan
            ),
            sign=rng.choice([-1.0, 1.0], n),
        )

    return make


@pytest.fixture(scope="session")
def model(make_chain, make_servos):
    """Return a four-joint self-model with two markers, covariance and everything else."""
    chain = make_chain(["generic", "intersecting", "parallel"], seed=3, markers=2)
    bare = SelfModel("bare", DhTable.from_chain(chain), make_servos(chain.joints, 3))
    parameters = bare.parameters
    free = tuple(name for name in parameters.names if name not in parameters.gauge)
    root = np.random.default_rng(5).normal(0.0, 1e-3, (len(free), len(free)))
    return SelfModel(
        "left arm: no. 1",
        bare.dh,
        bare.servos,
        covariance=ParameterCovariance(free, root @ root.T),
        noise_sigma=1.0 / 3000.0,
        robot={"urdf": "nico.urdf", "held": {"torso_yaw": 0.1}},
        fit={"method": "refine", "rms_mm": 1.0 / 3.0, "starts": [1, 2], "ok": True},
        provenance={"dataset": "wörld", "sha256": "00ab", "seed": None},
    )
