"""Backlash from the command line: simulated, recorded, learned, predicted by side."""

import csv
import io

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.model.self_model_file import load_model

from .one_line import assert_one_clear_line

SIMULATED = ("--imperfections", "clean", "--circle-points", "0", "--random", "60")


@pytest.fixture(scope="module")
def slack(tmp_path_factory, command):
    """Return a recording of an arm whose joints have a gap of a degree."""
    out = tmp_path_factory.mktemp("slack") / "data"
    done = command("simulate", "motion-capture", *SIMULATED, "--backlash", "0.5", "--out", out)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def learned(slack, tmp_path_factory, command):
    out = tmp_path_factory.mktemp("slack") / "arm"
    done = command("calibrate", "kinematics", slack, "--out", out, "--no-report")
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_a_simulated_gap_is_recorded_learned_and_predicted_by_side(slack, learned, command):
    data, model = load_dataset(slack), load_model(learned)
    assert data.approach[1:].any()
    assert np.abs(np.degrees(model.bending.backlash)) == pytest.approx(0.5, rel=0.2)
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow([*model.joints, *(f"approach.{joint}" for joint in model.joints)])
    for side in (-1, 0, 1):
        writer.writerow([*data.encoders[5], *[side] * len(model.joints)])
    done = command("predict", learned, "--table", "-", stdin=table.getvalue())
    assert done.returncode == 0, done.stderr
    below, middle, above = csv.DictReader(io.StringIO(done.stdout))
    assert float(middle["sigma_mm"]) > 3.0 * float(above["sigma_mm"])
    ends = [np.array([float(row[k]) for k in ("x_m", "y_m", "z_m")]) for row in (below, above)]
    assert 1e-3 < np.linalg.norm(ends[0] - ends[1]) < 0.05
    bad = table.getvalue().replace(",-1", ",2")
    assert_one_clear_line(
        command("predict", learned, "--table", "-", stdin=bad), "line 2", "is no side; expected 1"
    )


@pytest.mark.slow
def test_backlash_that_no_column_tells_is_asked_for_in_vain(slack, tmp_path, command):
    (data := tmp_path / "data").mkdir()
    for name in ("dataset.yaml", "samples.csv"):
        (data / name).write_text((slack / name).read_text())
    rows = list(csv.reader(io.StringIO((data / "samples.csv").read_text())))
    keep = [i for i, name in enumerate(rows[0]) if not name.startswith("approach.")]
    text = "\n".join(",".join(row[i] for i in keep) for row in rows)
    (data / "samples.csv").write_text(text + "\n")
    out = tmp_path / "out"
    words = ("--effects", "backlash", "--out", out, "--no-report")
    done = command("calibrate", "kinematics", data, *words)
    assert done.returncode == 0, done.stderr
    assert "approach.<joint>" in done.stdout


def test_wrong_words_are_one_line(learned, tmp_path, command):
    out = tmp_path / "out"
    negative = command("simulate", "motion-capture", "--backlash", "-1", "--out", out)
    assert negative.returncode == 2
    assert "--backlash" in negative.stderr
    no_eyes = command("export", "cameras", learned, "--format", "opencv", "--out", out)
    assert_one_clear_line(no_eyes, "has no camera")
    assert not out.exists()
