"""Self-models on disk: exact to the last bit, or one clear line."""

import copy
import dataclasses

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.document_values import damage
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.model.self_model_file import load_model, save_model


@pytest.fixture(scope="module")
def good_document(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("good") / "m.yaml"
    known = ParameterCovariance(("joint_0.r", "joint_1.r"), [[2e-6, 1e-6], [1e-6, 3e-6]])
    save_model(dataclasses.replace(model, covariance=known), path)
    load_model(path)
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.fixture
def document(good_document):
    """Return the document of a good model, to be spoilt."""
    return copy.deepcopy(good_document)


def assert_equal_to_the_last_bit(found, expected):
    assert type(found) is type(expected)
    for field in dataclasses.fields(expected):
        a, b = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(b, np.ndarray):
            assert (a.shape, a.tobytes()) == (b.shape, b.tobytes()), field.name
        elif dataclasses.is_dataclass(b):
            assert_equal_to_the_last_bit(a, b)
        else:
            assert a == b, field.name
            assert type(a) is type(b), field.name


def test_a_model_survives_its_file_to_the_last_bit(model, tmp_path):
    path = tmp_path / "self_model.yaml"
    save_model(model, path)
    assert_equal_to_the_last_bit(load_model(path), model)
    assert_equal_to_the_last_bit(load_model(tmp_path), model)
    save_model(load_model(path), tmp_path / "again.yaml")
    assert (tmp_path / "again.yaml").read_bytes() == path.read_bytes()


@settings(max_examples=30)
@given(
    kinds=st.lists(st.sampled_from(["generic", "parallel", "coaxial"]), max_size=6),
    seed=st.integers(0, 2**32 - 1),
    markers=st.integers(1, 3),
)
def test_any_arm_survives_its_file(make_chain, make_servos, tmp_path_factory, kinds, seed, markers):
    chain = make_chain(kinds, seed, markers)
    model = SelfModel("x", DhTable.from_chain(chain), make_servos(chain.joints, seed))
    path = tmp_path_factory.mktemp("model") / "m.yaml"
    save_model(model, path)
    assert_equal_to_the_last_bit(load_model(path), model)


@pytest.mark.parametrize(
    "number", [5e-324, 1e-7, 0.1, 1 / 3, 1e16, 123456789012345680.0, 1.7976931348623157e308, -0.0]
)
def test_awkward_numbers_survive(model, tmp_path, number):
    path = tmp_path / "m.yaml"
    values = np.array(model.dh.D)
    values[1] = min(number, 1e12)  # no arm is larger, and none is read
    changed = dataclasses.replace(
        model, table=dataclasses.replace(model.dh, D=values), fit={"number": number}
    )
    save_model(changed, path)
    assert load_model(path).dh.D.tobytes() == values.tobytes()
    assert load_model(path).fit["number"] == number


@pytest.mark.parametrize(
    "name", ["no", "1e3", "12e45", "3", "~", "a: b", "- x", "ünïcode", "0x1f", " edge "]
)
def test_awkward_names_stay_names(tmp_path, name):
    chain = Chain(
        (name, "b"), np.eye(3)[:2], np.zeros((2, 3)), (name,), np.array([[0.1, 0.2, 0.3]])
    )
    servos = ServoMap((name, "b"), [0, 0], [1, 1], ("rad", "rad"), [np.nan] * 2, [1, 1])
    model = SelfModel(name, DhTable.from_chain(chain), servos, provenance={name: name})
    save_model(model, tmp_path / "m.yaml")
    assert_equal_to_the_last_bit(load_model(tmp_path / "m.yaml"), model)


def test_a_person_may_write_numbers_as_people_do(document, tmp_path):
    text = yaml.safe_dump(document).replace(f"gear: {document['servos'][0]['gear']}", "gear: 1e0")
    (tmp_path / "m.yaml").write_text(text, encoding="utf-8")
    loaded = load_model(tmp_path / "m.yaml")
    assert loaded.servos.gear[0] == 1.0
    assert loaded.servos.gear[1] == document["servos"][1]["gear"]


def test_pythons_own_words_are_for_nobody():
    assert damage(TypeError("'float' object is not subscriptable")).startswith("a value in it is")
    assert damage(KeyError("gear")) == "'gear' is missing"
    assert damage(ValueError("gear\n is 0")) == "gear is 0"


def without(*keys):
    def spoil(document):
        for key in keys[:-1]:
            document = document[key]
        del document[keys[-1]]

    return spoil


def with_value(value, *keys):
    def spoil(document):
        for key in keys[:-1]:
            document = document[key]
        document[keys[-1]] = value

    return spoil


def with_twin_joints(document):
    for part in (document["chain"]["rows"], document["servos"]):
        part[1]["joint"] = part[0]["joint"]


def with_no_joints(document):
    document["chain"]["rows"], document["servos"] = [], []
    document["covariance"] = {}


SPOILT = {
    "no name": (without("name"), "'name' is missing"),
    "no chain": (without("chain"), "'chain' is missing"),
    "no rows": (without("chain", "rows"), "'rows' is missing"),
    "no alpha": (without("chain", "rows", 2, "alpha"), "'alpha' is missing"),
    "no gear": (without("servos", 1, "gear"), "'gear' is missing"),
    "no unit": (without("servos", 0, "unit"), "'unit' is missing"),
    "no covariance": (
        without("covariance"),
        "ends before .covariance.*copy it again",
    ),
    "no matrix": (without("covariance", "matrix"), "'matrix' is missing"),
    "one servo less": (without("servos", 3), "different joints"),
    "one covariance row less": (without("covariance", "matrix", 1), "not a valid self-model"),
    "chain is a number": (with_value(3, "chain"), "chain must be a mapping of names, got 3"),
    "rows are a word": (with_value("none", "chain", "rows"), "chain.rows must be a list of map"),
    "a row is a number": (with_value(1.0, "chain", "rows", 1), "chain.rows must be a list of map"),
    "a joint is a number": (with_value(1, "chain", "rows", 0, "joint"), "must be a list of names"),
    "servos are nothing": (with_value(None, "servos"), "servos must be a list of mappings"),
    "a unit is a list": (with_value(["rad"], "servos", 0, "unit"), "must be a list of names"),
    "a gear is a list": (with_value([1.0], "servos", 0, "gear"), "gear must be numbers, in rows"),
    "a camera is a word": (with_value("blue", "cameras", "left"), "left must be a mapping"),
    "noise is a list": (with_value([1.0], "noise_sigma_m"), "noise_sigma_m must be a number"),
    "hand is a list": (with_value([[0.0, 0.0, 0.1]], "chain", "hand"), "not a valid self-model"),
    "hand is nowhere": (with_value({}, "chain", "hand"), "not a valid self-model"),
    "robot is a word": (with_value("nico", "robot"), "not a valid self-model"),
    "text for a number": (with_value("wide", "chain", "rows", 0, "r"), "wide"),
    "nan": (with_value(float("nan"), "chain", "rows", 0, "r"), "finite"),
    "infinite": (with_value(float("inf"), "servos", 0, "offset"), "finite"),
    "negative gear": (with_value(-1.0, "servos", 0, "gear"), "gear must be positive"),
    "unknown unit": (with_value("turns", "servos", 0, "unit"), "turns"),
    "bad matrix": (with_value([[1.0]], "covariance", "matrix"), "covariance must have shape"),
    "a reflection": (
        with_value(np.diag([1.0, 1.0, -1.0, 1.0]).tolist(), "chain", "X_W0"),
        "rigid transform",
    ),
    "no transform": (
        with_value([*np.eye(4).tolist()[:3], [0.0, 0.0, 1.0, 1.0]], "chain", "X_W0"),
        "rigid transform",
    ),
    "a flat transform": (with_value(np.eye(3).tolist(), "chain", "X_W0"), r"\(4, 4\)"),
    "two joints of one name": (with_twin_joints, "joint_0"),
    "no joints": (with_no_joints, "joint"),
    "covariance of a stranger": (with_value("joint_9.r", "covariance", "names", 0), "joint_9.r"),
    "noise is a word": (with_value("small", "noise_sigma_m"), "not a valid self-model"),
    "pose noise is a word": (
        with_value({"sensor_sigma": "hand", "joint_sigma_rad": [0.0] * 4}, "fit", "pose_noise"),
        "fit.pose_noise.sensor_sigma must be numbers, got 'hand'",
    ),
    "pose noise of other joints": (
        with_value({"sensor_sigma": 1e-3, "joint_sigma_rad": [0.0] * 9}, "fit", "pose_noise"),
        "fit.pose_noise.joint_sigma_rad must be",
    ),
    "pose noise below zero": (
        with_value({"sensor_sigma": 1e-3, "joint_sigma_rad": -1.0}, "fit", "pose_noise"),
        "fit.pose_noise.joint_sigma_rad must be",
    ),
    "a mirror failed for a number": (with_value({"m": 1}, "fit", "mirror_failures"), "fit.m must"),
    "no median in pixels": (
        with_value({"n": 9, "median_m": 1e-3, "median_px": "x"}, "fit", "expected_error"),
        "median_px must be numbers",
    ),
    "a robot without a description": (with_value({"held": {}}, "robot"), "robot.urdf must be"),
    "a link is a number": (with_value({"urdf": "nico", "tip_link": 3}, "robot"), "robot.tip_link"),
    "held by a word": (
        with_value({"urdf": "nico", "held": {"a": "b"}}, "robot"),
        "robot.held of a",
    ),
    "a seed is a word": (with_value("x", "provenance", "seed"), "provenance.seed must be"),
    "another version": (with_value("nico-selfmodel/2", "format"), "nico-selfmodel/2, this version"),
    "another format": (with_value("nico-dataset/1", "format"), "not a self-model"),
    "no format": (without("format"), "expected `format: nico-selfmodel/1`"),
}


@pytest.mark.parametrize(("spoil", "message"), SPOILT.values(), ids=SPOILT)
def test_a_spoilt_file_is_refused_in_one_line(document, tmp_path, spoil, message):
    path = tmp_path / "spoilt.yaml"
    spoil(document)
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(ModelError, match=message) as caught:
        load_model(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"just words",
        b"- a\n- b\n",
        b"a: [1,\nb: }",
        b"\xff\xfe\x00garbage",
        b"a: !!python/x 1",
    ],
)
def test_garbage_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "garbage.yaml"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"garbage\.yaml") as caught:
        load_model(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ModelError, match=r"nowhere\.yaml does not exist"):
        load_model(tmp_path / "nowhere.yaml")
    with pytest.raises(ModelError, match=r"is empty; .* with self_model\.yaml"):
        load_model(tmp_path)


def test_a_model_that_cannot_be_written_leaves_the_old_file(model, tmp_path):
    path = tmp_path / "m.yaml"
    save_model(model, path)
    before = path.read_bytes()
    unwritable = dataclasses.replace(model, fit={"x": object()})
    with pytest.raises(yaml.YAMLError):
        save_model(unwritable, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["m.yaml"]
