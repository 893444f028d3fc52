"""What bends in an arm: moments of its weight, turns of its joints, derivatives."""

import numpy as np
import pytest

from nico_selfmodel.model.arm.bending import BEARING, LOADS, PARTS, SAG, Bending
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.loaded_posture import loaded
from nico_selfmodel.model.arm.uniform_rods import load_sigmas, uniform_rods

UP = np.array([0.0, 0.6, 0.8])
KINDS = ["generic", "intersecting", "parallel", "generic"]


@pytest.fixture
def table(make_chain):
    return DhTable.from_chain(make_chain(KINDS, 3, 2))


def bent(table, rng, *effects, size=1e-2):
    rigid = Bending.none(table.joints, UP, *uniform_rods(table)).with_effects(*effects)
    return rigid.with_values(rigid.values + size * rng.normal(size=len(rigid.values)))


def masses_of(table, q):
    """Weights and places of many pieces of the rods at a posture, with the link of each."""
    _, pivots = uniform_rods(table)
    zero = table.frames(np.zeros(len(table.joints)))
    feet = zero[:-1, :3, 3] + pivots[:, None] * zero[:-1, :3, 2]
    tip = zero[-1, :3, :3] @ table.p_NH.mean(axis=0) + zero[-1, :3, 3]
    ends = np.vstack([feet, tip])
    lengths = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    frames = table.frames(q)
    found = []
    for j, weight in enumerate(lengths / lengths.sum()):
        at = ends[j] + (np.arange(200)[:, None] + 0.5) / 200 * (ends[j + 1] - ends[j])
        local = (at - zero[j + 1, :3, 3]) @ zero[j + 1, :3, :3]
        moved = local @ frames[j + 1, :3, :3].T + frames[j + 1, :3, 3]
        found.append((j, np.full(200, weight / 200), moved))
    foot = frames[:-1, :3, 3] + pivots[:, None] * frames[:-1, :3, 2]
    return found, foot, frames


def test_moments_are_those_of_the_rods_weight(table):
    q = np.random.default_rng(0).uniform(-2, 2, len(table.joints))
    found, foot, frames = masses_of(table, q)
    bending = Bending.none(table.joints, UP, *uniform_rods(table))
    R = table.frames(q[None])[..., :3, :3]
    moments = bending.moments(R[:-1], R[1:])[:, 0]
    for i in range(len(table.joints)):
        torque = sum(
            (np.cross(p - foot[i], -UP) * m[:, None]).sum(axis=0) for j, m, p in found if j >= i
        )
        assert frames[i, :3, :3] @ moments[i] == pytest.approx(torque, abs=1e-4)


def test_a_joint_that_gives_way_lowers_what_it_carries(table):
    rng = np.random.default_rng(1)
    q = rng.uniform(-2, 2, (50, len(table.joints)))
    for i in range(len(table.joints)):
        soft = np.zeros(len(table.joints))
        soft[i] = 1e-2
        bending = Bending.none(table.joints, UP, *uniform_rods(table)).with_effects(SAG)
        sagging = bending.with_values(soft)
        heavy = [height(table, loaded(table, b, q)) for b in (bending, sagging)]
        assert (heavy[1] <= heavy[0] + 1e-12).all()


def height(table, posture):
    """Height of the weight, by the loads themselves: sum of up . R_j l_j."""
    loads, _ = uniform_rods(table)
    return np.einsum("jnab,jb,a->n", posture.frames[1:, :, :3, :3], loads, UP)


def test_loads_scatter_as_those_of_links_that_are_no_rods(table):
    """Drawn by their own masses, each twice or half as heavy as it may be, with its centre of mass
    anywhere along the rod and somewhat beside it."""
    rng, n = np.random.default_rng(3), len(table.joints)
    _, pivots = uniform_rods(table)
    zero = table.frames(np.zeros(n))
    feet = zero[:-1, :3, 3] + pivots[:, None] * zero[:-1, :3, 2]
    tip = zero[-1, :3, :3] @ table.p_NH.mean(axis=0) + zero[-1, :3, 3]
    rod = np.diff(np.vstack([feet, tip]), axis=0)
    length = np.linalg.norm(rod, axis=1)
    likely = 0.5 * (length / length.sum() + 1.0 / n)
    drawn = []
    for _ in range(4000):
        mass = likely * (1.0 + np.log(2.0) * rng.normal(size=n))
        centre = rng.uniform(size=(n, 1)) * rod + 0.2 * length.mean() * rng.normal(size=(n, 3))
        beyond = mass[::-1].cumsum()[::-1] - mass
        moment = mass[:, None] * centre + beyond[:, None] * rod
        drawn.append(np.einsum("jba,jb->ja", zero[1:, :3, :3], moment))
    found = load_sigmas(table)
    # What a weight and a place do together, about a quarter of some, is left out.
    assert found == pytest.approx(np.std(drawn, axis=0), rel=0.25)
    assert found.max() > 3.0 * found.min()


def test_an_arm_without_bends_is_the_rigid_arm(table):
    q = np.random.default_rng(2).uniform(-2, 2, (5, len(table.joints)))
    bending = Bending.none(table.joints, UP, *uniform_rods(table)).with_effects(*PARTS)
    assert loaded(table, bending, q).frames == pytest.approx(table.frames(q), abs=1e-15)


@pytest.mark.parametrize(
    "effects",
    [
        *((effect,) for effect in (SAG, BEARING, "backlash", "ripple", "coupling")),
        pytest.param(PARTS, marks=pytest.mark.slow),
    ],
)
def test_every_number_moves_the_hand_as_its_derivative_says(table, make_servos, effects):
    rng = np.random.default_rng(4)
    bending = bent(table, rng, *effects, size=1e-3)
    parameters = DhParameters(table, make_servos(table.joints, 1), bending=bending)
    angles, marker = rng.uniform(-2, 2, (20, len(table.joints))), np.arange(20) % 2
    side = rng.integers(-1, 2, angles.shape)
    _, jacobian = parameters.predict(angles, marker, side)
    values = parameters.values
    assert parameters.with_values(values).values == pytest.approx(values, abs=1e-15)
    first = len(values) - len(bending.names)
    for k in range(len(values)):
        step = np.zeros(len(values))
        step[k] = 1e-5
        high, low = (
            parameters.with_values(values + s).points(angles, marker, side) for s in (step, -step)
        )
        slope = (high - low) / 2e-5
        # What bends turns what it bends; the geometry's part of the moments is left out.
        worst = 2e-2 if k < first else 6e-3 if LOADS in effects or BEARING in effects else 1e-4
        assert jacobian[:, :, k] == pytest.approx(slope, abs=worst * max(np.abs(slope).max(), 1e-3))


def test_a_joint_is_behind_its_drive_by_half_the_gap(table, make_servos):
    gaps = Bending.none(table.joints, UP, *uniform_rods(table)).with_effects("backlash")
    gaps = gaps.with_values(np.full(len(table.joints), 0.01))
    parameters = DhParameters(table, make_servos(table.joints, 1), bending=gaps)
    angles = np.random.default_rng(6).uniform(-2, 2, (20, len(table.joints)))
    rose = parameters.points(angles, np.zeros(20, dtype=int), np.ones(angles.shape))
    behind = parameters.points(angles - 0.01 * parameters.servos.gear, np.zeros(20, dtype=int))
    assert rose == pytest.approx(behind, abs=1e-15)


def test_one_posture_is_that_of_many(table):
    rng = np.random.default_rng(5)
    bending = bent(table, rng, *PARTS)
    q = rng.uniform(-2, 2, (3, len(table.joints)))
    together = loaded(table, bending, q)
    for k in range(3):
        assert loaded(table, bending, q[k]).frames == pytest.approx(together.frames[:, k])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"up": [0.0, 0.0, 0.0]}, "up must be a direction of length 1"),
        ({"effects": ("sagging",)}, "no effect 'sagging'"),
        ({"coupling": np.eye(5)}, "its own part belongs to its gear"),
    ],
)
def test_what_cannot_bend_is_refused(table, change, words):
    bending = Bending.none(table.joints, UP, *uniform_rods(table))
    fields = {name: getattr(bending, name) for name in bending.__dataclass_fields__}
    with pytest.raises(ValueError, match=words):
        Bending(**(fields | change))


def test_an_effect_that_does_not_exist_is_refused(table):
    still = Bending.none(table.joints, UP, *uniform_rods(table))
    with pytest.raises(ValueError, match="no effect 'saag'"):
        still.with_effects("sag", "saag")
