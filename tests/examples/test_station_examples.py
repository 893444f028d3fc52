"""The examples that compose diagrams run and say what they should."""

import os
import re
import subprocess
import sys

import pytest

from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.plant import ArmDescription


@pytest.fixture
def run(project_root, tmp_path):
    def run_example(name, *words):
        path = project_root / "examples" / name
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 100
        places = os.pathsep.join([str(project_root), os.environ.get("PYTHONPATH", "")])
        done = subprocess.run(
            [sys.executable, "-W", "error::DeprecationWarning", str(path), *map(str, words)],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": places},
            timeout=240,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert list(tmp_path.iterdir()) == []
        return done.stdout

    return run_example


@pytest.mark.slow
def test_a_station_in_a_diagram_sees_its_hand_about_where_its_description_puts_it(run):
    out = run("05_station_in_a_diagram.py")
    errors = [float(x) for x in re.search(r"off by \[([\d. ]+)\]", out)[1].split()]
    assert len(errors) == 2
    assert 0.5 < max(errors) < 80.0


@pytest.mark.slow
def test_a_tracker_of_ones_own_finds_the_red_tape(run):
    assert int(run("06_your_own_tracker.py").splitlines()[-1].split()[0]) >= 4


@pytest.mark.slow
def test_an_arm_of_ones_own_is_learned(run):
    assert run("07_your_own_urdf_arm.py").startswith("PASS")


@pytest.mark.slow
def test_motion_capture_comes_from_another_process(run):
    out = run("08_motion_capture_from_another_process.py")
    assert out.startswith("40 frames")
    assert int(re.search(r"moved (\d+) mm", out)[1]) > 30


@pytest.mark.slow
def test_servos_follow_a_diagram_of_ones_own(run):
    out = run("09_servos_in_a_diagram.py")
    low, high = re.search(r"from (-[\d.]+) to ([\d.]+) rad", out).groups()
    assert -0.31 < float(low) < -0.2
    assert 0.2 < float(high) < 0.31
    assert "wrist: holding" in out
    assert "the wrist moved by 0.00 rad" in out


@pytest.mark.slow
def test_a_hand_before_a_mirror_is_seen_about_where_it_was_put(run):
    out = run("10_before_a_mirror.py").splitlines()[-1]
    seen, off = re.match(r"(\d) of 3 seen, (\d+) px off", out).groups()
    assert int(seen) >= 2
    assert 0 < int(off) < 80


def test_a_client_of_the_motor_server_moves_the_elbow(run):
    assert run("11_motors_of_another_process.py").endswith("the elbow stands at 0.30 rad\n")


@pytest.mark.slow
def test_a_body_that_watches_itself_names_the_encoder_that_jumped(run):
    pose, cause = re.match(
        r"alarm at pose (\d+): (.*)", run("12_a_body_that_watches_itself.py")
    ).groups()
    assert 30 <= int(pose) < 45
    assert cause == "zero of right_elbow"


@pytest.mark.slow
def test_learned_arms_plan_and_fall_in_a_plant_of_ones_own(run):
    out = run("13_learned_arms_in_your_plant.py")
    assert float(re.search(r"solved True, ([\d.]+) um away", out)[1]) < 10.0
    assert "6 and 4 learned joints fell" in out


@pytest.mark.slow
def test_directives_name_a_learned_arm_and_the_model_visualizer_shows_it(run, tmp_path_factory):
    arm, ones = ArmDescription.named("nico", "right_arm"), [1.0] * 4
    servos = ServoMap(arm.joints, [0.0] * 4, ones, ("rad",) * 4, [float("nan")] * 4, ones)
    table = DhTable.from_chain(arm.chain)
    path = tmp_path_factory.mktemp("result") / "self_model.yaml"
    save_model(SelfModel("nico", table, servos, robot=arm.source), path)
    out = run("14_directives_and_model_visualizer.py", path.parent, "--once")
    assert "learned: right_shoulder_pitch, " in out
    assert "http://localhost" in out
