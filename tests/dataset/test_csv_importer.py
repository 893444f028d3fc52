import re

import numpy as np
import pytest
import yaml

from nico_selfmodel.dataset.importers.csv_importer import import_csv
from nico_selfmodel.errors import DataError

TABLE = """\
id,q1,q2,X,Y,Z,u,v,circle,dot
5,0,90,100.5,-20,3,320,240,q_one,tip
6,10,90,,,,321,241,q_one,tip
7,20,90,NaN,nan,NaN,,,,tip
"""
NOTHINGS = "".join(f"{k},{k},9,{0 if k < 10 else k},0,0,1,1,,tip\n" for k in range(8, 30))
"""Rows of which two have points that were not seen."""
MAP = {
    "joints": [
        {"name": "q_one", "column": "q1", "encoder_unit": "counts", "counts_per_turn": 4096},
        {"name": "q_two", "column": 3, "encoder_unit": "deg", "sign": -1},
    ],
    "point": {"x": "X", "y": "Y", "z": 6, "unit": "mm"},
    "not_measured": ["nan"],
}


@pytest.fixture
def table(tmp_path):
    """Return a function that writes a table and returns its path."""

    def write(text=TABLE):
        (tmp_path / "arm.csv").write_text(text)
        return tmp_path / "arm.csv"

    return write


def test_a_map_says_which_column_holds_what(table):
    columns = {"sample": "id", "sweep": "circle", "marker": 10}
    pixels = {"left_u": "u", "left_v": "v"}
    dataset = import_csv(table(), {**MAP, **columns, "pixels": pixels, "point_sigma_m": 0.001})
    assert dataset.name == "arm"
    assert dataset.joint_names == ("q_one", "q_two")
    assert dataset.joints[1].sign == -1
    assert dataset.sample.tolist() == [5, 6, 7]
    assert dataset.sweep.tolist() == ["q_one", "q_one", ""]
    assert dataset.markers == ("tip",)
    assert dataset.encoders.tolist() == [[0, 90], [10, 90], [20, 90]]
    assert dataset.p_WH_measured[0].tolist() == [0.1005, -0.02, 0.003]
    assert dataset.measured.tolist() == [True, False, False]
    np.testing.assert_array_equal(dataset.pixels[0], [320, 240, np.nan, np.nan])
    assert dataset.point_sigma_m == 0.001


def test_a_reading_may_be_a_sum_of_columns_as_of_a_differential(table):
    q_one, q_two = MAP["joints"]
    joints = [{**q_one, "column": {"q1": 0.5, 3: -0.5}}, q_two]
    assert import_csv(table(), {**MAP, "joints": joints}).encoders[:, 0].tolist() == [-45, -40, -35]


def test_what_is_wrong_is_told_in_the_headings_of_the_table(table):
    text = TABLE + NOTHINGS
    for columns, words in (({}, "row 4"), ({"sample": "id"}, "id 8")):
        with pytest.raises(DataError, match=rf"csv: X, Y, Z are exactly 0 .* of {words}\)"):
            import_csv(table(text), {**MAP, **columns})


def test_a_folder_that_is_called_like_a_column_keeps_its_name_in_messages(tmp_path):
    path = tmp_path / "sample" / "arm.csv"
    path.parent.mkdir()
    path.write_text(TABLE + NOTHINGS)
    with pytest.raises(DataError, match="X, Y, Z are exactly 0") as raised:
        import_csv(path, MAP)
    assert str(path) in str(raised.value)


def test_samples_are_numbered_from_one_and_the_hand_is_the_marker(table):
    dataset = import_csv(table(), MAP, name="mine", source="lab")
    assert (dataset.name, dataset.source) == ("mine", "lab")
    assert dataset.sample.tolist() == [1, 2, 3]
    assert dataset.markers == ("hand",)
    assert dataset.sweep.tolist() == ["", "", ""]


def test_a_column_may_say_from_which_side_a_joint_came(table):
    sides = (
        TABLE.replace("dot\n", "dot,s1\n")
        .replace("tip\n", "tip,-1\n", 1)
        .replace("tip\n", "tip,\n")
    )
    one, two = MAP["joints"]
    column_map = {**MAP, "joints": [one | {"approach": "s1"}, two]}
    dataset = import_csv(table(sides), column_map)
    assert dataset.approach.tolist() == [[-1, 0], [0, 0], [0, 0]]
    with pytest.raises(DataError, match=r"arm\.csv, line 2, column 's1': -2 is no side"):
        import_csv(table(sides.replace("tip,-1", "tip,-2")), column_map)


def test_the_map_may_lie_in_a_file_and_the_table_have_no_header(table, tmp_path):
    (tmp_path / "map.yaml").write_text(
        yaml.safe_dump(
            {
                "header": False,
                "joints": [{"name": "a", "column": 1, "encoder_unit": "rad"}],
                "point": {"x": 2, "y": 3, "z": 4, "unit": "cm"},
            }
        )
    )
    dataset = import_csv(table("1.5,10,20,30\n1.6,11,21,31\n"), tmp_path / "map.yaml")
    assert dataset.encoders.ravel().tolist() == [1.5, 1.6]
    assert dataset.p_WH_measured[1].tolist() == [0.11, 0.21, 0.31]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"point": {**MAP["point"], "unit": "inch"}}, "must be one of m, cm, mm, got 'inch'"),
        ({"point": {"x": "X", "y": "Y", "unit": "m"}}, "'z' is missing; expected x, y, z"),
        ({"point": {**MAP["point"], "zz": 4}}, "'point': unknown key 'zz', did you mean 'z'"),
        ({"point": {**MAP["point"], "z": 5}}, "column 'Y' is given for point y and for point z"),
        ({"point": {**MAP["point"], "x": 2}}, "'q1' is given for joint q_one and for point x"),
        ({"point": "X"}, "'point' must be a mapping of x, y, z, unit"),
        ({"joint": []}, "column map: unknown key 'joint', did you mean 'joints'"),
        ({"joints": []}, "'joints' must be a list with 'name', 'column' and 'encoder_unit'"),
        ({"joints": [{"name": "a", "encoder_unit": "rad"}]}, "joint 1: expected 'name', 'column'"),
        (
            {"joints": [{"name": "a", "encoder_unit": "rad", "column": {"q1": "half"}}]},
            "joint 1: a sum of columns is a factor of each",
        ),
        ({"sample": "ID2"}, "column 'ID2' is missing, but 'id' looks like it"),
        ({"sample": 11}, "'sample': there is no column 11; "),
        ({"sample": True}, "a column is a name or a number from 1, got True"),
        ({"sample": "X"}, "line 2, column 'X': '100.5' is not a whole number"),
        ({"sweep": "dot"}, "line 2, column 'dot': there is no joint 'tip'; joints are q_one"),
        ({"header": "no"}, "'header' must be true or false"),
        ({"not_measured": "nan"}, "'not_measured' must be a list"),
        ({"not_measured": []}, "line 4, column 'X': 'NaN' is not a finite number"),
        ({"point": None}, "arm.csv: nothing was measured"),
        ({"point_sigma_m": -1}, "point_sigma_m must be positive"),
    ],
)
def test_a_map_that_does_not_fit_is_refused(table, changes, message):
    with pytest.raises(DataError, match=re.escape(message)):
        import_csv(table(), {**MAP, **changes})


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(DataError, match=r"arm\.csv: there is no such file"):
        import_csv(tmp_path / "arm.csv", MAP)
    with pytest.raises(DataError, match="is a folder, a file was expected"):
        import_csv(tmp_path, MAP)


def test_the_wrong_unit_of_length_is_questioned(table):
    text = TABLE.replace("6,10,90,,,", "6,10,90,90000,1,1")
    with pytest.raises(DataError, match="were millimetres given as metres"):
        import_csv(table(text), {**MAP, "point": {**MAP["point"], "unit": "m"}})


@pytest.mark.real_data
def test_a_real_table_is_imported_without_a_change_to_it(real_data_folder):
    names = [f"q{k}_rad" for k in range(1, 8)]
    axes = {axis: f"X_board_camera_{row}3" for row, axis in enumerate("xyz")}
    column_map = {
        "joints": [{"name": n, "column": n, "encoder_unit": "rad"} for n in names],
        "point": {**axes, "unit": "m"},
    }
    dataset = import_csv(real_data_folder / "franka_fr3" / "measurements.csv", column_map)
    train, test = dataset.split(0.3, 0)
    # The arm was measured again where it stood, six times: 108 poses, 32 of them held out.
    assert len(np.unique(dataset.pose)) == 108
    assert len(np.unique(test.pose)) == 32
    assert (len(train), len(test)) == (81, 33)
    assert dataset.measured.all()
    assert np.linalg.norm(dataset.encoder_span) > 1.0
