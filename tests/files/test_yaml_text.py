"""YAML is refused before anything is built from it, and read the same way by everybody."""

import math
import time

import pytest
import yaml

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.dataset.importers.csv_importer import import_csv
from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.files.yaml_text import DEEPEST, MOST_VALUES, parse_yaml, yaml_text
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config
from nico_selfmodel.vision.color.color_model import ColorModel

NINE_DEEP = "\n".join(
    ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
)
MERGED_NINE_DEEP = "\n".join(
    ["a0: &a0 {" + ", ".join(f"k{i}: 1" for i in range(10)) + "}"]
    + [f"a{i}: &a{i}\n  <<: [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
)
HOSTILE = {
    "brackets": ("[" * 100_000, "nested more than 32 deep"),
    "braces": ("{a: " * 100_000, "nested more than 32 deep"),
    "dashes": ("- " * 100_000, "nested more than 32 deep"),
    "aliases that multiply": (NINE_DEEP, "more than 3000000 values"),
    "merges that multiply": (MERGED_NINE_DEEP, "more than 3000000 values"),
    "an alias of itself": ("a: &a [*a]", "stands before or inside what it names"),
    "a long text and its aliases": (
        f"a: &a {'x' * 10**6}\nb: [{'*a,' * 999}]",
        "more than 3000000",
    ),
    "a million digits": (f"a: {'9' * 10**6}", "a number of 1000000 characters"),
    "a million hexadecimal digits": (f"a: 0x{'f' * 10**6}", "a number of 1000002 characters"),
    "base sixty": (f"a: 1{':1' * 10**5}", "a number of 200001 characters"),
    "10^400": ("a: 1e400", "is larger than any number here"),
    "2^200": (f"a: {2**200}", "is larger than any number here"),
    "code": ("a: !!python/object/apply:os.getcwd []", "is not read here"),
    "a set": ("a: !!set {b, c}", "is not read here"),
    "a control character": ("a: \x01", "control characters are not allowed"),
    "two documents": ("a: 1\n---\nb: 2\n", "another document"),
    "a key that is a list": ("? [a, b]\n: c\n", "stands where a key belongs"),
    "a key that is a mapping": ("{{0}: 1}", "stands where a key belongs"),
    "a key twice": ("{a: 1, b: {c: 1, c: 2}}", "key 'c' stands here and in line 1"),
}


@pytest.mark.parametrize(("text", "message"), HOSTILE.values(), ids=HOSTILE)
def test_hostile_yaml_is_refused_at_once_and_in_one_line(text, message):
    began = time.perf_counter()
    with pytest.raises(SelfModelError, match=message) as caught:
        parse_yaml(text, "x.yaml")
    assert time.perf_counter() - began < 5.0
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300
    assert str(caught.value).startswith("x.yaml")


def _of_data_set(path):
    path.rename(path.with_name("dataset.yaml"))
    path.with_name("samples.csv").write_text("sample,encoder.a\n1,2\n")
    load_dataset(path.parent)


READERS = {
    "self-model": load_model,
    "servo configuration": load_servo_config,
    "colour": ColorModel.load,
    "column map": lambda path: import_csv(path, path),
    "data set": _of_data_set,
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
@pytest.mark.parametrize("text", ["[" * 100_000, NINE_DEEP], ids=["brackets", "aliases"])
def test_every_reader_of_yaml_refuses_it_alike(read, text, tmp_path):
    path = tmp_path / "hostile.yaml"
    path.write_text(text)
    with pytest.raises(SelfModelError, match=r"nested more than|more than 3000000 values"):
        read(path)


@pytest.mark.parametrize(
    ("text", "number"),
    [
        *(("1e-3", 1e-3), ("1.5e3", 1500.0), (".5e3", 500.0), ("1E5", 1e5), ("-2e+2", -200.0)),
        *(("1_000", 1000), ("0x10", 16), ("7", 7), ("-.inf", -math.inf)),
    ],
)
def test_a_number_is_one_to_everybody(text, number):
    assert parse_yaml(f"a: {text}", "x")["a"] == number


@pytest.mark.parametrize("text", ["1e-3", "1.5e3", "12e45", "no", "~", "0x1f", "a: b", "\x85", ""])
def test_text_that_looks_like_something_else_stays_text(text):
    assert parse_yaml(yaml_text({"a": text, text or "b": [text]}), "x")["a"] == text


def test_what_is_written_twice_is_written_out_and_read_back():
    shared = [1.0, 2.0]
    text = yaml_text({"a": shared, "b": {"c": shared}})
    assert "&" not in text
    assert parse_yaml(text, "x") == {"a": shared, "b": {"c": shared}}


def test_a_few_anchors_are_as_good_as_ever():
    text = "z: &z {x: 1}\na: {<<: *z, y: 2}\nb: [*z, *z]\n"
    assert parse_yaml(text, "x")["b"] == [{"x": 1}, {"x": 1}]
    assert parse_yaml(text, "x")["a"] == {"x": 1, "y": 2}


def test_the_limits_are_where_they_are_said_to_be(monkeypatch):
    nested = "[" * DEEPEST + "]" * DEEPEST
    assert parse_yaml(nested, "x") is not None
    with pytest.raises(SelfModelError, match="deep"):
        parse_yaml(f"[{nested}]", "x")
    assert MOST_VALUES > 1000**2  # a covariance of a thousand parameters
    monkeypatch.setattr("nico_selfmodel.files.yaml_text.MOST_VALUES", 3000)
    values = "1," * 2998
    assert len(parse_yaml(f"[{values}]", "x")) == 2998
    with pytest.raises(SelfModelError, match="values"):
        parse_yaml(f"[{values}1,1]", "x")


def test_what_cannot_be_written_is_said():
    with pytest.raises(yaml.YAMLError):
        yaml_text({"a": object()})
