import re

import numpy as np
import pytest

from nico_selfmodel.dataset.importers.vicon_importer import import_vicon
from nico_selfmodel.dataset.importers.vicon_trajectories import read_trajectories
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError

# Written as Nexus does: other blocks first, blank lines between, cells cut off at the end.
EXPORT = """\

Devices
1000
,,Force plate - Force,,
Frame,Sub Frame,Fx,Fy,Fz
,,N,N,N
1,0,0.1,0.2,0.3
1,1,0.1,0.2,0.3

Model Outputs
100
,,Nico:CentreOfMass,,,
Frame,Sub Frame,X,Y,Z
,,mm,mm,mm
1,0,9,9,9

Trajectories
100
,,Nico:wrist,,,Nico:elbow,,,*17,,
Frame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm,mm,mm,mm
11,0,100,20,300,50,60,70,1,1,1
12,0,102,22,302,,,
13,0,,,,,,,1,1,1
14,0,104,24,304,,,,
15,0,200,24,304,,,,2,2,2
"""
READINGS = """\
frame_start,frame_end,shoulder,encoder.elbow,sweep
11,14,100,5,home
12,14,200,5,shoulder
15,15,300,5,shoulder
"""
UNIT = ("counts", 4096)
JOINTS = (JointInfo("shoulder", *UNIT), JointInfo("elbow", *UNIT))


@pytest.fixture
def files(tmp_path):
    """Return a function that writes an export and readings and returns their paths."""

    def write(export=EXPORT, readings=READINGS):
        (tmp_path / "trial.csv").write_text(export, newline="")
        (tmp_path / "readings.csv").write_text(readings, newline="")
        return tmp_path / "trial.csv", tmp_path / "readings.csv"

    return write


def test_points_are_averaged_over_settled_intervals_without_their_gaps(files):
    dataset = import_vicon(*files(), *UNIT)
    assert dataset.name == "trial"
    assert dataset.joints == JOINTS
    assert dataset.sample.tolist() == [1, 1, 2, 2, 3, 3]
    assert dataset.marker.tolist() == ["wrist", "elbow"] * 3
    assert dataset.sweep.tolist() == ["home"] * 2 + ["shoulder"] * 4
    assert dataset.encoders[::2].tolist() == [[100, 5], [200, 5], [300, 5]]
    np.testing.assert_allclose(
        dataset.p_WH_measured[[0, 1, 2, 4]],
        [[0.102, 0.022, 0.302], [0.05, 0.06, 0.07], [0.103, 0.023, 0.303], [0.2, 0.024, 0.304]],
        rtol=1e-15,
    )
    assert dataset.measured.tolist() == [True, True, True, False, True, False]
    assert dataset.extra["frames_used"] == ("3", "1", "2", "0", "1", "0")
    assert dataset.extra["frame_start"] == ("11", "11", "12", "12", "15", "15")


@pytest.mark.parametrize("markers", [["wrist"], ["Nico:wrist"]])
def test_single_frames_and_chosen_markers_are_enough(files, markers):
    readings = "frame,a,b,sample\n11,0,1,7\n13,0,2,8\n"
    dataset = import_vicon(*files(readings=readings), encoder_unit="rad", markers=markers)
    assert dataset.joints == (JointInfo("a", "rad"), JointInfo("b", "rad"))
    assert dataset.markers == ("wrist",)
    assert dataset.sample.tolist() == [7, 8]
    assert dataset.measured.tolist() == [True, False]


def test_readings_may_say_from_which_side_joints_came(files):
    sides = READINGS.replace("sweep\n", "sweep,approach.elbow\n").replace("home\n", "home,-1\n")
    sides = sides.replace("shoulder\n", "shoulder,\n")
    dataset = import_vicon(*files(readings=sides), *UNIT)
    first = dataset.sample == dataset.sample[0]
    assert (dataset.approach[first] == [0, -1]).all()
    assert not dataset.approach[~first].any()
    with pytest.raises(DataError, match=r"readings\.csv, line 2.*'down' is not a number"):
        import_vicon(*files(readings=sides.replace("home,-1", "home,down")), *UNIT)


def test_metres_windows_newlines_and_a_padded_title_are_understood(files):
    text = EXPORT.replace("mm", "m").replace("Trajectories", "Trajectories,,,")
    path, _ = files("\ufeff" + text.replace("\n", "\r\n"))
    trajectories = read_trajectories(path)
    assert trajectories.frames.tolist() == [11, 12, 13, 14, 15]
    assert trajectories.points["wrist"][0].tolist() == [100.0, 20.0, 300.0]


def test_a_block_below_the_trajectories_ends_them(files):
    below = (
        EXPORT + "\nModel Outputs\n100\n,,a,,\nFrame,Sub Frame,X,Y,Z\n,,deg,deg,deg\n1,0,1,2,3\n"
    )
    assert len(read_trajectories(files(below)[0]).frames) == 5


def test_markers_of_two_subjects_keep_their_full_names(files):
    path, _ = files(EXPORT.replace("Nico:elbow", "Wand:wrist"))
    assert list(read_trajectories(path).points) == ["Nico:wrist", "Wand:wrist"]
    assert list(read_trajectories(path, ["*17", "Wand:wrist"]).points) == ["*17", "Wand:wrist"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Trajectories", "Joints", "no block 'Trajectories' (blocks found: Devices, Model Outputs"),
        (",", ";", "trial.csv, line 20: the cells are not separated by commas"),
        ("Trajectories", "Trajectories;;", "trial.csv: the cells are not separated by commas"),
        (EXPORT[EXPORT.index("11,0,100") :], "", "line 17: the block 'Trajectories' has no frames"),
        ("Trajectories\n100", "Trajectories\nfast", "line 18, frame rate: 'fast' is not a number"),
        (",,mm,mm,mm,mm", ",,in,in,in,mm", "must be mm or m, got 'in,in,in'"),
        (",,mm,mm,mm,mm", ",,mm,mm,m,mm", "must be mm or m, got 'mm,mm,m'"),
        ("Frame,Sub Frame,X,Y,Z,X", "Frame,Sub Frame,X,Y,X,Z", "expected the axes X,Y,Z in column"),
        ("Frame,Sub Frame,X,Y,Z,X", "Time,X,Y,Z,X", "line 20: expected the row 'Frame,Sub Frame"),
        ("Nico:wrist,,,Nico:elbow", "*15,,,*16", "line 19: no marker has a name"),
        ("12,0,102", "12,0,1o2", "line 23, marker 'wrist': '1o2' is not a number"),
        ("12,0,102", "12,0,", "line 23, marker 'wrist': one of X, Y, Z is empty"),
        ("12,0,102", "11,0,102", "line 23: frame 11 follows frame 11"),
        ("12,0,102", "x,0,102", "line 23: 'x' is not the number of a frame"),
        ("11,0,100", "11,0,1,2,3,100", "line 22: more cells than the 11 columns"),
    ],
)
def test_a_bad_export_is_refused_with_its_place(files, old, new, message):
    with pytest.raises(DataError, match=re.escape(message)):
        import_vicon(*files(EXPORT.replace(old, new)), *UNIT)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("15,15", "15,99", "line 4, column 'frame_end': frame 99 is not in "),
        ("12,14", "14,12", "line 3, column 'frame_end': frame_end 12 lies before frame_start 14"),
        ("12,14", "11,14", "line 3, column 'frame_start': frame 11 is there twice, in line 2, too"),
        ("frame_end", "frame", "give column 'frame' or 'frame_start' and 'frame_end'"),
        ("frame_start", "start", "column 'frame_start' is missing"),
        ("5,home", "5,hme", "line 2, column 'sweep': there is no joint 'hme'"),
        ("200", "", "line 3, column 'shoulder': the cell is empty"),
    ],
)
def test_bad_readings_are_refused_with_their_place(files, old, new, message):
    with pytest.raises(DataError, match=re.escape(message)):
        import_vicon(*files(readings=READINGS.replace(old, new)), *UNIT)


def test_a_marker_that_is_not_there_is_named_beside_those_that_are(files):
    with pytest.raises(DataError, match=r"no marker 'wirst', did you mean 'wrist'.*wrist, elbow"):
        import_vicon(*files(), *UNIT, markers=["wirst"])


def test_a_unit_of_counts_says_how_many_and_readings_have_joints(files):
    with pytest.raises(DataError, match="needs a positive counts_per_turn"):
        import_vicon(*files(), encoder_unit="counts")
    with pytest.raises(DataError, match=r"readings\.csv: no column of a joint beside the frames"):
        import_vicon(*files(readings="frame,sweep\n11,\n"), encoder_unit="rad")
