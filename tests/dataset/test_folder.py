import re
import string
import warnings
from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis.extra.numpy import arrays

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import content_hash, load_dataset, save_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.plausibility import refuse_nothings
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import read_yaml_mapping

from .conftest import METADATA, SAMPLES

ARRAYS = ("sample", "encoders", "p_WH_measured", "sweep", "marker", "pixels", "mirror")
OTHERS = ("name", "joints", "point_sigma_m", "pixel_sigma_px", "image_size", "cameras", "source")


def assert_same(one: Dataset, other: Dataset) -> None:
    """Compare all fields, floats bit by bit."""
    for key in ARRAYS:
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key), err_msg=key)
    assert np.array_equal(np.signbit(one.encoders), np.signbit(other.encoders))
    assert {key: getattr(one, key) for key in OTHERS} == {
        key: getattr(other, key) for key in OTHERS
    }
    assert content_hash(one) == content_hash(other)


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


# ------------------------------------------------------------------------------ round trip


def test_a_data_set_survives_the_round_trip(dataset, tmp_path):
    save_dataset(dataset, tmp_path / "new" / "data")
    assert_same(load_dataset(tmp_path / "new" / "data"), dataset)


finite = st.floats(-1e12, 1e12)
coordinate = st.floats(-5.0, 5.0)
letters = st.text(string.ascii_letters + "-_ .,:#'\"é漢0159", min_size=1, max_size=12).map(
    str.strip
)
label = letters.filter(lambda text: text not in ("", "home"))
free_text = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
formulas = st.sampled_from(["=1+1", "'=1", "-", "-1.5", "@x", "\tx", "'", "''+"])


@st.composite
def datasets(draw):
    names = draw(st.lists(label, min_size=1, max_size=3, unique=True))
    units = [draw(st.sampled_from(["counts", "rad", "deg"])) for _ in names]
    turn = st.floats(1.0, 1e9)
    joints = [
        JointInfo(
            name,
            unit,
            counts_per_turn=draw(turn) if unit == "counts" else None,
            lower=draw(st.none() | st.floats(-1e9, -1e-9)),
            upper=draw(st.none() | st.floats(1e-9, 1e9)),
            sign=draw(st.sampled_from([1, -1])),
        )
        for name, unit in zip(names, units, strict=True)
    ]
    rows = draw(st.integers(1, 5))
    points = draw(arrays(np.float64, (rows, 3), elements=coordinate))
    points[draw(arrays(np.bool_, rows, elements=st.booleans()))] = np.nan
    pixels = draw(arrays(np.float64, (rows, 4), elements=finite))
    pixels[0] = abs(pixels[0])
    notes = draw(st.lists(free_text | formulas, min_size=rows, max_size=rows))
    encoders = draw(arrays(np.float64, (rows, len(joints)), elements=finite))
    in_rad = np.array(units) == "rad"  # beyond two turns in some samples, those are in degrees
    encoders[:, in_rad] = np.remainder(encoders[:, in_rad], 4.0 * np.pi)
    return Dataset(
        name=draw(label),
        joints=tuple(joints),
        sample=np.array(
            draw(
                st.lists(
                    st.integers(-(2**63), 2**63 - 1), min_size=rows, max_size=rows, unique=True
                )
            )
        ),
        encoders=encoders,
        p_WH_measured=points,
        marker=np.array([draw(label) for _ in range(rows)]),
        mirror=np.array([draw(label | st.just("")) for _ in range(rows)]),
        pixels=pixels,
        point_sigma_m=draw(st.none() | st.floats(1e-9, 1.0)),
        source=draw(free_text),
        seed=draw(st.none() | st.integers(1 - 2**128, 2**128 - 1)),
        extra={"remark of somebody": tuple(notes)},
    )


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.too_slow])
@given(dataset=datasets())
def test_any_data_set_survives_the_round_trip(dataset, tmp_path_factory):
    folder = tmp_path_factory.mktemp("round") / "trip"
    with warnings.catch_warnings():
        # A marker may well be missing while a note sounds like it.
        warnings.simplefilter("ignore", UserWarning)
        save_dataset(dataset, folder)
        loaded = load_dataset(folder)
    assert_same(loaded, dataset)
    save_dataset(loaded, folder.with_name("again"))
    assert files(folder) == files(folder.with_name("again"))


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_radians_that_look_like_degrees_are_questioned(folder, unit):
    metadata = METADATA.replace("encoder_unit: deg, lower: -5, upper: 120", f"encoder_unit: {unit}")
    path = folder(metadata=metadata)
    if unit == "deg":
        load_dataset(path)
        return
    with pytest.warns(UserWarning, match=r"elbow span up to 65 rad, 10\.3 turns: .*unit: deg"):
        load_dataset(path)


def test_the_hash_knows_the_contents_and_not_the_notation(folder):
    plain = load_dataset(folder())
    rows = [line.split(",") for line in SAMPLES.replace('"slow, twice"', "").splitlines()]
    turned = "\r\n".join(",".join([*row[5:], *row[:5]]) for row in rows)
    dressed = "\ufeff" + turned.replace("100,", "1e2,").replace("40.5", " 40.50 ") + "\r\n\r\n"
    other = load_dataset(folder(dressed, "\ufeff" + METADATA.replace("\n", "\r\n")))
    same_notes = tuple(note.replace("slow, twice", "") for note in plain.extra["note"])
    assert content_hash(replace(plain, extra={"note": same_notes})) == content_hash(other)
    points = other.p_WH_measured.copy()
    points[0, 0] = np.nextafter(points[0, 0], 1.0)
    assert content_hash(replace(other, p_WH_measured=points)) != content_hash(other)
    assert content_hash(replace(other, seed=1)) != content_hash(other)


def test_columns_that_nobody_filled_have_defaults(folder):
    dataset = load_dataset(
        folder("z_m,encoder.elbow,sample,x_m,encoder.shoulder,y_m\n3,2,5,1,4,2\n")
    )
    assert dataset.encoders.tolist() == [[4.0, 2.0]]
    assert dataset.p_WH_measured.tolist() == [[1.0, 2.0, 3.0]]
    assert (dataset.marker[0], dataset.sweep[0], dataset.mirror[0]) == ("hand", "", "")


def test_metadata_in_full_is_read(folder):
    text = METADATA + (
        "point_sigma_m: 1e-3\nimage_size: [640, 480]\nseed: 7\nsource: lab\n"
        "cameras: {left: {fx: 500.0}}\n"
    )
    dataset = load_dataset(folder(metadata=text))
    assert (dataset.point_sigma_m, dataset.image_size, dataset.seed) == (0.001, (640, 480), 7)
    assert dataset.cameras == {"left": {"fx": 500.0}}
    assert dataset.joints[0].counts_per_turn == 4096.0
    assert (dataset.joints[1].lower, dataset.joints[1].upper) == (-5.0, 120.0)


# -------------------------------------------------------------------------------- bad input


def swap(old, new):
    assert old in SAMPLES
    return SAMPLES.replace(old, new, 1)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ("", "samples.csv: the file is empty"),
        (SAMPLES.splitlines()[0], "no rows below the header"),
        (SAMPLES.replace(",", ";"), "separated by semicolons; export the table with commas"),
        (swap("encoder.elbow", "encoder.elbo"), "column 'encoder.elbow' is missing, but "
         "'encoder.elbo' looks like it"),
        (swap("sample,", "Sample,"), "column 'sample' is missing, but 'Sample' looks like it"),
        (swap(",z_m", ",z_mm"), "column 'z_m' is missing, but 'z_mm' looks like it"),
        (swap("note", "x_m"), "column 'x_m' appears more than once"),
        (swap("300", "3OO"), "line 3, column 'encoder.shoulder': '3OO' is not a number"),
        (swap("0.27", '"0,27"'), "line 7, column 'x_m': '0,27' is not a number; use a decimal"),
        (swap("0.27", "NaN"), "line 7, column 'x_m': 'NaN' is not a finite number; an empty cell"),
        (swap("0.27", "-inf"), "line 7, column 'x_m': '-inf' is not a finite number"),
        (swap("220", ""), "line 7, column 'encoder.shoulder': the cell is empty"),
        (swap("220", "2_20"), "line 7, column 'encoder.shoulder': '2_20' is not a number"),
        (swap("\n6,", "\n6.5,"), "line 7, column 'sample': '6.5' is not a whole number"),
        (swap("\n6,", "\n,"), "line 7, column 'sample': '' is not a whole number"),
        (swap("\n6,", "\n" + "6" * 30 + ","), "line 7, column 'sample': '666"),
        (swap("\n6,", "\n\n\n2,"), "line 9, column 'sample': sample 2 with marker 'hand' is al"
         "ready in line 3; give each pose its own sample number"),
        (swap("\n6,,hand,220,15", "\n5,elbow,hand,100,80"), "line 7, column 'sample': sample 5 "
         "with marker 'hand' is already in line 6; tags of one id cannot be told apart, give each"),
        (swap("\n4,elbow,", "\n4,elbo,"), "line 5, column 'sweep': there is no joint 'elbo'; "
         "joints are shoulder, elbow; 'home'"),
        (swap("0.27,0.15", "0.27,"), "line 7, column 'y_m': the cell is empty but others of x_m"),
        (swap("\n6,,hand,", "\n6,,"), "line 7: 8 cells, but the table has 9 columns"),
        (swap('"slow, twice"', '"slow'), "line 4: not a valid CSV row"),
        (swap("\n6,,hand", '\n6,,"a\tb"'), "line 7, column 'marker': a marker must be printable"),
        (swap("\n6,,hand,220", "\n5,elbow,tip,220"), "line 7, column 'encoder.shoulder': sample 5 "
         "has reading 220.0 here and 100.0 in line 6; all markers"),
        (re.sub("(300|500),", "100,", SAMPLES), "the sweep of joint 'shoulder' did not move it: "
         "encoder.shoulder is 100.0 in all its 2 rows"),
        (swap("300,40.5", "300,90.5"), "in the sweep of joint 'shoulder' joint 'elbow' moved more"),
        (SAMPLES.replace(",0.", ",1"), "were millimetres given as metres?"),
        (re.sub(r",0\.\d+", ",", SAMPLES), "nothing was measured: no row has x_m, y_m, z_m or"),
    ],
)  # fmt: skip
def test_a_bad_table_is_refused_with_its_place(folder, samples, message):
    path = folder(samples)
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        load_dataset(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_line_is_counted_as_an_editor_shows_it(folder):
    text = SAMPLES.replace("start", '"two\nlines"').replace("220", "x").replace("\n", "\r\n")
    with pytest.raises(DataError, match=r"line 8, column 'encoder\.shoulder'"):
        load_dataset(folder(text))


def test_millimetres_given_as_metres_are_questioned(folder):
    text = SAMPLES.replace("0.27,0.15,0.2,", "127000.0,0.0,0.0,")
    with pytest.raises(DataError, match=r"spread over 1.27e\+05 m: were millimetres given as metr"):
        load_dataset(folder(text))


@pytest.mark.parametrize(("rows", "copies", "refused"), [(30, 10, True), (40, 13, False)])
def test_rows_that_stand_there_again_are_refused_where_they_are_many(folder, rows, copies, refused):
    head, line = SAMPLES.splitlines()[:2]
    cells = line.split(",")
    at = head.split(",").index("encoder.elbow")

    def row(k, reading):
        return ",".join([str(k), *cells[1:at], f"{reading}.5", *cells[at + 1 :]])

    readings = [*range(rows), *range(copies)]
    path = folder("\n".join([head, *(row(k, q) for k, q in enumerate(readings))]) + "\n")
    if not refused:
        assert len(load_dataset(path)) == rows + copies
        return
    with pytest.raises(DataError, match="10 of 40 rows are copies, to the last digit, of earlier"):
        load_dataset(path)


@pytest.mark.parametrize(("beyond", "told"), [(0.9, False), (1.1, True)])
def test_readings_beyond_the_ends_of_a_joint_by_a_twentieth_of_its_range_are_told(
    folder, beyond, told
):
    reading = 120.0 + 0.05 * beyond * 125.0  # it ends at 120, 125 above its lower end
    path = folder(SAMPLES.replace("hand,100,80,", f"hand,100,{reading},"))
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        load_dataset(path)
    words = [str(one.message) for one in seen]
    assert [f"elbow reads 15 to {reading:.5g}, its lower and upper are -5 and 120" in one
            for one in words] == [True] * told  # fmt: skip


@pytest.mark.parametrize(("rows", "other", "told"), [(10, 0, True), (9, 0, False), (10, 1, False)])
def test_joints_that_read_the_same_throughout_are_told(folder, rows, other, told):
    head, line = SAMPLES.splitlines()[:2]
    cells = line.split(",")

    def row(k):
        reading = [str(k), str(k + other * (k == 3))]
        return ",".join([str(k), "", "hand", *reading, f"0.{k + 10}", *cells[6:]])

    path = folder("\n".join([head, *map(row, range(rows))]) + "\n")
    same = f"'shoulder' and 'elbow' read the same in all {rows} rows"
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        load_dataset(path)
    assert any(same in str(one.message) for one in seen) == told


def test_a_misspelt_optional_column_is_kept_with_a_warning(folder):
    path = folder(SAMPLES.replace("sweep,", "sweeps,"))
    with pytest.warns(UserWarning, match="'sweeps' is kept but not used, did you mean 'sweep'"):
        dataset = load_dataset(path)
    assert dataset.extra["sweeps"][0] == "home"
    assert (dataset.sweep == "").all()


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ("", "dataset.yaml: the file is empty"),
        ("- a\n- b\n", "expected a mapping ('key: value' lines), got list"),
        ("name: a\njoints: [\n", "dataset.yaml, line 3: not valid YAML"),
        ("name: a\nname: b\n", "line 2: not valid YAML: key 'name' stands here and in line 1"),
        ("joints:\n- {a: 1, a: 2}\n", "line 2: not valid YAML: key 'a' stands here and in line 2"),
        ("when: 2024-99-99\n", "not valid YAML: month must be in 1..12"),
        ("when: !!timestamp noon\n", "not valid YAML"),
        (METADATA.replace("format", "Format"), "'format' is missing, but 'Format' looks like it"),
        (METADATA.replace("dataset/1", "dataset/2"), "a recording of any body (nico-dataset/2);"
         " give it to `calibrate body` or `calibrate hand-eye`, or with a body to `evaluate`,"
         " `monitor` or `choose-poses`"),
        (METADATA.replace("dataset/1", "dataset/3"), "version 3 of the format ('nico-dataset/3') is"
         " not supported; this program reads 'nico-dataset/1'"),
        (METADATA.replace("dataset/1", "selfmodel/1"), "not a data set: format is 'nico-selfmodel"),
        (METADATA.replace("name: bench", "name: 12"), "'name' must be text, got 12; put"),
        (METADATA.replace("name: bench", ""), "key 'name' is missing"),
        (METADATA + "point_sigma: 1\n", "unknown key 'point_sigma', did you mean 'point_sigma_m'"),
        (METADATA + "point_sigma_m: .inf\n", "'point_sigma_m' must be a finite number, got inf"),
        (METADATA + "point_sigma_m: true\n", "'point_sigma_m' must be a finite number, got True"),
        (METADATA + "point_sigma_m: -1\n", "point_sigma_m must be positive"),
        (METADATA + "seed: 1.5\n", "'seed' must be a whole number"),
        (METADATA + "image_size: [640]\n", "'image_size' must be [width, height]"),
        (METADATA + "cameras: 4\n", "'cameras' must be a mapping"),
        (METADATA.partition("joints")[0], "'joints' must be a list with one entry per joint"),
        (METADATA + "  - 5\n", "joint 3: a joint must be a mapping"),
        (METADATA.replace("elbow", "shoulder"), "joint 2: 'shoulder' is already an earlier joint"),
        (METADATA.replace("unit: deg", "unit: grad"), "joint 2: joint 'elbow': encoder_unit must "
         "be one of rad, deg, counts, got 'grad'"),
        (METADATA.replace(", counts_per_turn: 4096", ""), "needs a positive counts_per_turn"),
        (METADATA.replace("lower", "lowest"), "unknown key 'lowest', did you mean 'lower'"),
    ],
)  # fmt: skip
def test_bad_metadata_are_refused_with_their_place(folder, metadata, message):
    path = folder(metadata=metadata)
    with pytest.raises(DataError, match=re.escape(message)) as caught:
        load_dataset(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_merged_may_be_overridden_and_stands_once(tmp_path):
    """Merging writes into what it takes from, which here is read only afterwards."""
    path = tmp_path / "merged.yaml"
    path.write_text("z: &z {x: 1}\na:\n  b: &b\n    <<: *z\n    x: 2\nc:\n  <<: *b\n1: d\n'1': e\n")
    merged = {"x": 2}
    assert read_yaml_mapping(path) == {
        "z": {"x": 1},
        "a": {"b": merged},
        "c": merged,
        1: "d",
        "1": "e",
    }


def test_a_missing_folder_or_file_is_named(folder, tmp_path):
    with pytest.raises(DataError, match="nowhere does not exist; a data set is a folder"):
        load_dataset(tmp_path / "nowhere")
    path = folder()
    with pytest.raises(DataError, match="csv is a file; a data set"):
        load_dataset(path / "samples.csv")
    (path / "samples.csv").unlink()
    with pytest.raises(DataError, match=r"samples\.csv is missing"):
        load_dataset(path)
    (path / "dataset.yaml").unlink()
    with pytest.raises(DataError, match="is empty; a data set is a folder"):
        load_dataset(path)


def test_text_that_is_not_utf_8_is_refused(folder):
    path = folder()
    (path / "samples.csv").write_bytes(SAMPLES.encode("utf-16"))
    with pytest.raises(DataError, match=r"samples.csv: not UTF-8 text \(byte 0\)"):
        load_dataset(path)


# ------------------------------------------------------------------------- whole or nothing


def test_an_existing_folder_is_replaced_only_when_asked(dataset, folder):
    path = folder()
    (path / "images").mkdir()
    (path / "images" / "left.png").touch()
    before = files(path)
    with pytest.raises(DataError, match="the folder exists"):
        save_dataset(dataset, path)
    assert files(path) == before
    save_dataset(dataset, path, force=True)
    assert_same(load_dataset(path), dataset)
    assert (path / "images" / "left.png").exists()
    assert [other.name for other in path.parent.iterdir()] == ["data"]


def test_what_is_not_a_data_set_is_never_replaced(dataset, tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(DataError, match="holds something that is not a data set"):
        save_dataset(dataset, tmp_path, force=True)
    with pytest.raises(DataError, match="a file of this name exists"):
        save_dataset(dataset, tmp_path / "thesis.txt", force=True)
    with pytest.raises(DataError, match=r"cannot be written: File exists .*thesis\.txt"):
        save_dataset(dataset, tmp_path / "thesis.txt" / "data")
    assert files(tmp_path) == {"thesis.txt": b"years of work"}


@pytest.mark.parametrize("step", ["write_bytes", "replace"])
def test_a_failure_half_way_leaves_the_old_data(dataset, folder, monkeypatch, step):
    path = folder()
    before = files(path)
    real = getattr(type(path), step)

    def fail(self, argument):
        # With replace, fail only where the new folder takes its place.
        if step != "replace" or re.fullmatch(r"\.data\..*\.part", self.name):
            raise OSError(28, "No space left on device")
        return real(self, argument)

    monkeypatch.setattr(type(path), step, fail)
    with pytest.raises(DataError, match="cannot be written: No space left on device"):
        save_dataset(dataset, path, force=True)
    assert files(path) == before
    assert [other.name for other in path.parent.iterdir()] == ["data"]


def test_what_could_not_be_loaded_again_is_not_written(dataset, tmp_path):
    with pytest.raises(DataError, match="nothing was measured"):
        save_dataset(dataset.select(~dataset.measured), tmp_path / "data")
    with pytest.raises(ValueError, match="cameras must be plain data"):
        save_dataset(replace(dataset, cameras={"left": np.eye(3)}), tmp_path / "data")
    assert not list(tmp_path.iterdir())


def test_both_parts_of_a_split_can_be_saved(dataset, tmp_path):
    circles = dataset.select(dataset.sweep != "")
    for part, name in zip(circles.split(0.25, 1), ("train", "test"), strict=True):
        save_dataset(part, tmp_path / name)
        assert_same(load_dataset(tmp_path / name), part)


def test_the_files_are_plain_to_read(dataset, tmp_path):
    save_dataset(dataset.select(np.arange(2)), tmp_path / "data")
    content = yaml.safe_load((tmp_path / "data" / "dataset.yaml").read_text())
    assert content["format"] == "nico-dataset/1"
    assert content["joints"][1] == {
        "name": "elbow", "encoder_unit": "deg", "lower": -5.0, "upper": 120.0, "sign": -1
    }  # fmt: skip
    header = (tmp_path / "data" / "samples.csv").read_text().splitlines()[0]
    assert header == "sample,sweep,marker,encoder.shoulder,encoder.elbow,x_m,y_m,z_m,note"


def test_a_table_without_names_of_columns_is_told_so(folder):
    lines = SAMPLES.splitlines(keepends=True)
    numbers = "".join(",".join("7" if i != 1 else "" for i in range(9)) + "\n" for _ in lines)
    with pytest.raises(DataError, match="line 1: expected the names of the columns, got numbers"):
        load_dataset(folder(numbers))


@pytest.mark.parametrize(
    ("zeros", "others", "refused"), [(2, 10, True), (1, 10, False), (2, 9, False)]
)
def test_places_that_are_exactly_nothing_are_refused(zeros, others, refused):
    places = np.vstack([np.zeros((zeros, 3)), np.ones((others, 3))])
    sample = np.arange(5, 5 + len(places))
    if not refused:
        refuse_nothings(sample, places, "x_m, y_m, z_m")
        return
    with pytest.raises(DataError, match=r"exactly 0 in 2 rows \(the first of sample 5\)"):
        refuse_nothings(sample, places, "x_m, y_m, z_m")


def test_nothing_is_saved_that_could_not_be_loaded_again(folder, tmp_path):
    data = load_dataset(folder(SAMPLES))
    joints = tuple(JointInfo(joint.name, "rad") for joint in data.joints)
    degrees = np.where(np.arange(len(data))[:, None] < 2, 90.0, 0.1 * (1.0 + data.encoders % 7.0))
    wrong = replace(data, joints=joints, encoders=degrees, sweep=None)
    with pytest.raises(DataError, match="were degrees given as radians there"):
        save_dataset(wrong, tmp_path / "again")
    assert not (tmp_path / "again").exists()
