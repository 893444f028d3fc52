"""Arms to test with: Nico's, and random ones with what makes Drake's parsers differ."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription

from ..slow_rest import slow_rest

NICO = ("right_arm", "left_arm", "neck")
# Axes 0.05 deg off parallel; root link "world"; joint counts; the hand on the last axis.
RANDOM = ("near_parallel", "world", "six", "seven", "parallel", "on_axis")
AXES = ("0 0 1", "0 1 0", "-1 0 0", "0.6 0 -0.8", "1 2 3")


def numbers(values) -> str:
    return " ".join(repr(float(x)) for x in values)


def origin(rng, *, identity=False) -> str:
    if identity:
        return ""
    rpy = rng.choice([0.0, np.pi / 2, -np.pi / 2, 0.7], 3)
    return f'<origin xyz="{numbers(rng.uniform(-0.3, 0.3, 3))}" rpy="{numbers(rpy)}"/>'


def link(rng, name, *, mesh=None) -> str:
    drawn = f'<visual><geometry><mesh filename="{mesh}"/></geometry></visual>' if mesh else ""
    return f"""
  <link name="{name}">
    <inertial>{origin(rng)}<mass value="{rng.uniform(0.5, 2.0)}"/>
      <inertia ixx="0.010" iyy="0.011" izz="0.012" ixy="0.001" ixz="0" iyz="0"/></inertial>
    <visual>{origin(rng)}<geometry><box size="0.1 0.05 0.02"/></geometry></visual>
    <collision><geometry><drake:ellipsoid a="0.1" b="0.05" c="0.02"/></geometry></collision>
    {drawn}
  </link>"""


def random_urdf(kind: str, *, mesh: str | None = None) -> str:
    """Return an arm `base` -> `tip`, with a fixed and a held joint in it and a branch beside it."""
    rng = np.random.default_rng(7 + len(kind))
    n = 7 if kind == "seven" else 6
    names = ["world" if kind == "world" else "base", *(f"link{i}" for i in range(1, n + 1))]
    parts = [link(rng, name, mesh=mesh if name == "link2" else None) for name in names[1:]]
    parts += [] if kind == "world" else [link(rng, "base")]
    for i in range(n):
        axis, place = AXES[i % 5], origin(rng, identity=i % 3 == 1)
        if kind.endswith("parallel") and i in (1, 2, 3):
            tilt = "0.0009 0 0" if kind == "near_parallel" and i == 2 else "0 0 0.4"
            axis, place = "0 0 1", f'<origin xyz="0.3 0.02 {0.1 * i}" rpy="{tilt}"/>'
        parent = "bracket" if i == 2 else names[i]
        limits = "" if i == 4 else f'lower="-{1 + 0.1 * i}" upper="{2 + 0.1 * i}" '
        parts.append(f"""
  <joint name="joint{i + 1}" type="{"continuous" if i == 4 else "revolute"}">
    <parent link="{parent}"/><child link="{names[i + 1]}"/>{place}<axis xyz="{axis}"/>
    <limit {limits}velocity="3" effort="{5 + i}"/>
    <dynamics damping="0.{i + 1}"/>
  </joint>
  <transmission><type>transmission_interface/SimpleTransmission</type>
    <joint name="joint{i + 1}"/><actuator name="motor{i + 1}"/></transmission>""")
    last = names[-1]
    along = AXES[(n - 1) % 5].split()
    out = (0.3 * np.array(along, dtype=float)) if kind == "on_axis" else rng.uniform(0.1, 0.3, 3)
    fixed = '<joint name="{0}" type="fixed"><parent link="{1}"/><child link="{2}"/>{3}</joint>'
    slide = '<axis xyz="0 1 0"/><limit lower="0" upper="1" velocity="1" effort="1"/>'
    parts += [
        link(rng, "bracket"),
        fixed.format("weld2", "link2", "bracket", origin(rng)),
        link(rng, "tip"),
        f'<joint name="slide" type="prismatic"><parent link="{last}"/><child link="tip"/>'
        f"{'' if kind == 'on_axis' else origin(rng)}{slide}</joint>",
        '<link name="ball"/>',
        fixed.format("ball_mount", last, "ball", f'<origin xyz="{numbers(out)}"/>'),
        '<frame name="tool" link="tip" xyz="0.1 0.2 0.3" rpy="0.1 0 0"/>',
        f'<frame name="flange" link="{last}" xyz="-0.2 0.1 0.1" rpy="0.4 0 0.3"/>',
        link(rng, "finger"),
        '<joint name="curl" type="revolute"><parent link="tip"/><child link="finger"/>'
        f"{origin(rng)}{slide}</joint>",
    ]
    return (
        f'<?xml version="1.0"?>\n<!-- a -- b -->\n<robot name="{kind}">{"".join(parts)}\n</robot>\n'
    )


def individual(nominal: Chain, seed: int, size: float = 0.02) -> Chain:
    """Return the arm as built: axes and points off, seen from elsewhere, its zero elsewhere."""
    rng = np.random.default_rng(seed)
    n, m = len(nominal.joints), len(nominal.markers)
    turns = [rotation_from_vector(v) for v in rng.normal(0.0, size, (n, 3))]
    directions = np.stack([r @ d for r, d in zip(turns, nominal.directions, strict=True)])
    built = replace(
        nominal,
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        points=nominal.points + rng.normal(0.0, 0.2 * size, (n, 3)),
        p_WH_zero=nominal.p_WH_zero + rng.normal(0.0, 0.2 * size, (m, 3)),
    )
    elsewhere = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    return built.moved(elsewhere).rezeroed(rng.normal(0.0, 0.5, n))


def self_model(chain: Chain, unit: str = "counts", like: DhTable | None = None) -> SelfModel:
    n = len(chain.joints)
    servos = ServoMap(
        chain.joints,
        offset=np.linspace(-1.0, 1.0, n),
        gear=np.linspace(0.9, 1.6, n),
        unit=(unit,) * n,
        counts_per_turn=np.full(n, 4096.0 if unit == "counts" else np.nan),
        sign=np.where(np.arange(n) % 2 == 0, 1.0, -1.0),
    )
    return SelfModel("individual", DhTable.from_chain(chain, like), servos)


@pytest.fixture(scope="session")
def describe(tmp_path_factory):
    """Return a function that describes one of the arms by its kind."""
    folder = tmp_path_factory.mktemp("robots")
    read = {}

    def arm(kind: str, **changes) -> ArmDescription:
        key = kind, repr(changes)
        if key not in read:
            read[key] = described(kind, changes)
        return read[key]

    def described(kind: str, changes: dict) -> ArmDescription:
        if kind in NICO:
            return ArmDescription.named("nico", kind)
        urdf = Path(folder / f"{kind}.urdf")
        urdf.write_text(random_urdf(kind))
        choice = {
            "tip_link": "tip",
            "held": {"slide": 0.0 if kind == "on_axis" else 0.05},
            "points": {"ball": "ball", "tool": "tool", "flange": "flange"},
        }
        return ArmDescription.from_urdf(urdf, **{**choice, **changes})

    return arm


@pytest.fixture(params=slow_rest(("right_arm", *RANDOM, "left_arm", "neck"), plain=3))
def arm(request, describe):
    """Return every arm in turn."""
    return describe(request.param)


@pytest.fixture
def urdf_text():
    """Return the function that writes the text of a random robot."""
    return random_urdf


@pytest.fixture
def build_individual():
    """Return the function that builds an individual arm from a nominal one."""
    return individual


@pytest.fixture
def learn():
    """Return the function that puts a chain into a self-model."""
    return self_model


@pytest.fixture
def drake_warnings():
    """Return what Drake logged as warnings or errors during the test."""
    records: list[str] = []

    class Keeper(logging.Handler):
        def emit(self, record):
            records.append(record.getMessage())

    keeper, logger = Keeper(logging.WARNING), logging.getLogger("drake")
    logger.addHandler(keeper)
    yield records
    logger.removeHandler(keeper)
