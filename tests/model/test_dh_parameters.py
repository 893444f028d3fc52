"""The named Denavit-Hartenberg parameters: derivatives, gauges, rank."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.dh_table import DhTable

SEED = st.integers(0, 2**32 - 1)
KINDS = ["generic", "intersecting", "parallel", "near-parallel", "anti-parallel"]


@pytest.fixture
def make_parameters(make_chain, make_servos):
    def make(kinds, seed=0, markers=1):
        chain = make_chain(kinds, seed, markers)
        return DhParameters(DhTable.from_chain(chain), make_servos(chain.joints, seed))

    return make


def observe(parameters, seed, count=60):
    """Return encoder angles of random poses and the markers they show."""
    rng, n = np.random.default_rng(seed), len(parameters.table.joints)
    q = rng.uniform(-2.5, 2.5, (count, n))
    angles = parameters.servos.to_radians(parameters.servos.to_encoder(q))
    return angles, np.arange(count) % len(parameters.table.markers)


def rank_of(jacobian, columns):
    matrix = jacobian.reshape(-1, jacobian.shape[2])[:, columns]
    length = np.linalg.norm(matrix, axis=0)
    values = np.linalg.svd(matrix[:, length > 0] / length[length > 0], compute_uv=False)
    return int(np.sum(values > 1e-9 * values[0]))


def test_names_values_and_units_tell_the_table(make_parameters):
    parameters = make_parameters(["generic"], seed=2, markers=2)
    table, servos = parameters.table, parameters.servos
    value = dict(zip(parameters.names, parameters.values, strict=True))
    unit = dict(zip(parameters.names, parameters.units, strict=True))
    assert list(value)[:8] == [
        *("M0.x", "M0.y", "M0.z", "M0.rx", "M0.ry", "M0.rz"),
        *("joint_0.D", "joint_0.theta_offset"),
    ]
    assert value["joint_1.r"] == table.r[1]
    assert value["hand.marker_1.z"] == table.p_NH[1, 2]
    offset = value["joint_1.theta_offset"] + servos.gear[1] * table.theta_zero[1]
    assert offset == pytest.approx(servos.offset[1])
    assert (unit["joint_0.alpha"], unit["joint_0.gear"], unit["M0.rz"]) == ("rad", "1", "rad")
    assert {unit[name] for name in ("M0.x", "joint_1.D", "joint_1.r", "hand.marker_0.x")} == {"m"}


@settings(max_examples=40)
@given(data=st.data(), seed=SEED, markers=st.integers(1, 3))
def test_values_put_back_give_the_same_arm(make_chain, make_servos, data, seed, markers):
    kinds = data.draw(st.lists(st.sampled_from(KINDS), max_size=6))
    chain = make_chain(kinds, seed, markers)
    parameters = DhParameters(DhTable.from_chain(chain), make_servos(chain.joints, seed))
    again = parameters.with_values(parameters.values)
    assert again.values == pytest.approx(parameters.values, abs=1e-11)
    angles, marker = observe(parameters, seed, 5)
    found, expected = (p.predict(angles, marker)[0] for p in (again, parameters))
    assert found == pytest.approx(expected, abs=1e-11)
    assert expected == pytest.approx(
        chain.forward((angles - parameters.servos.offset) / parameters.servos.gear, marker),
        abs=1e-11,
    )


@pytest.mark.parametrize("base", [0.0, 1e-7, 1.0, np.pi - 1e-3])
def test_the_derivatives_in_the_dh_view_are_those_of_central_differences(make_parameters, base):
    parameters = make_parameters(["generic", "near-parallel", "intersecting"], 5, markers=2)
    values = parameters.values.copy()
    values[3:6] = base * np.array([0.6, -0.48, 0.64])
    values[[11 + 6, 11 + 12]] += 0.2  # twists of rows that need none
    parameters = parameters.with_values(values)
    angles, marker = observe(parameters, 6, 8)
    jacobian = parameters.predict(angles, marker)[1]
    h = 1e-6
    for k, name in enumerate(parameters.names):
        step = h * np.eye(len(values))[k]
        ahead, behind = (
            parameters.with_values(values + s).predict(angles, marker)[0] for s in (step, -step)
        )
        numeric = (ahead - behind) / (2.0 * h)
        assert jacobian[:, :, k] == pytest.approx(numeric, abs=2e-8), name


@settings(max_examples=40)
@given(
    kinds=st.lists(st.sampled_from(["generic", "intersecting"]), max_size=6),
    seed=SEED,
    markers=st.integers(1, 3),
)
def test_all_but_the_gauge_is_identifiable_and_nothing_else(
    make_chain, make_servos, kinds, seed, markers
):
    chain = make_chain(kinds, seed, markers)
    parameters = DhParameters(DhTable.from_chain(chain), make_servos(chain.joints, seed))
    n, names = len(chain.joints), parameters.names
    angles, marker = observe(parameters, seed, 100)
    jacobian = parameters.predict(angles, marker)[1]
    free = [i for i, name in enumerate(names) if name not in parameters.gauge]
    assert len(free) == 5 * n + 3 * markers
    assert rank_of(jacobian, free) == 5 * n + 3 * markers
    assert rank_of(jacobian, range(len(names))) == 5 * n + 3 * markers


@pytest.mark.parametrize(
    "kinds",
    [
        ["parallel"],
        ["anti-parallel", "generic"],
        ["generic", "parallel", "generic"],
        ["generic", "parallel", "parallel", "generic", "generic"],
        ["parallel", "parallel", "generic", "parallel"],
        ["near-parallel"] * 3,
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_rows_between_parallel_axes_keep_the_rank(make_parameters, kinds, seed):
    parameters = make_parameters(kinds, seed)
    names, n = parameters.names, len(kinds) + 1
    angles, marker = observe(parameters, seed, 100)
    jacobian = parameters.predict(angles, marker)[1]
    free = [i for i, name in enumerate(names) if name not in parameters.gauge]
    rank = rank_of(jacobian, range(len(names)))
    assert len(free) == 5 * n + 3
    # The line view counts what can be told at all: parallel axes tell as much as others.
    assert rank_of(jacobian, free) == rank


def test_the_model_of_the_thesis_has_exactly_three_gauges(make_parameters):
    parameters = make_parameters(["generic"] * 3, seed=1)
    thesis = [
        i
        for i, name in enumerate(parameters.names)
        if name.startswith("M0.") or (name.startswith("joint") and not name.endswith("beta"))
    ]
    assert len(thesis) == 26
    jacobian = parameters.predict(*observe(parameters, 2, 100))[1]
    assert rank_of(jacobian, thesis) == 23
    pinned = {"joint_0.D", "joint_0.theta_offset", "joint_3.alpha"}
    rest = [i for i in thesis if parameters.names[i] not in pinned]
    assert rank_of(jacobian, rest) == len(rest) == 23
    assert pinned <= parameters.gauge


def test_the_gauge_is_named(make_parameters):
    betas = {"joint_0.beta", "joint_2.beta"}
    hand = {f"hand.marker_0.{axis}" for axis in "xyz"}
    ends = {"joint_0.D", "joint_0.theta_offset", "joint_2.alpha"}
    ordinary = make_parameters(["generic", "generic"], 1, markers=2)
    assert ordinary.gauge == ends | betas | hand | {"joint_1.beta"}
    inner = make_parameters(["generic", "parallel"], 1)
    assert inner.gauge == ends | betas | hand | {"joint_1.D"}
    leading = make_parameters(["parallel", "generic"], 1)
    assert leading.gauge == ends | hand | {"joint_1.D", "joint_1.beta", "joint_2.beta"}


@pytest.mark.parametrize("gap", [0.0, 9e-7])
def test_a_base_turned_by_half_a_turn_keeps_its_pose(gap, make_servos):
    turn = rotation_from_vector((np.pi - gap) * np.array([0.48, 0.6, 0.64]))
    chain = Chain(
        ("a", "b"), np.eye(3)[[2, 0]], np.zeros((2, 3)), ("hand",), np.array([[0.0, 0.2, 0.1]])
    ).moved(transform(turn, np.array([0.1, 0.2, 0.3])))
    table = DhTable.from_chain(chain)
    table = DhTable(
        *(table.joints, transform(turn, table.X_W0[:3, 3]), table.D, table.theta_zero, table.r),
        *(table.alpha, table.beta, table.markers, table.p_NH),
    )
    parameters = DhParameters(table, make_servos(chain.joints))
    again = parameters.with_values(parameters.values)
    pose = again.table.X_W0
    assert pose == pytest.approx(table.X_W0, abs=1e-10)
