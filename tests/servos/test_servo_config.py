"""The servo configuration: read, checked, and every mistake named with file and key."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from nico_selfmodel.errors import DataError
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.servos import JointServo
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.trajectory import acceleration_step
from nico_selfmodel.systems.looking import looking_body

from .arms import COUNTS_PER_TURN, configuration

JOINT = {
    "name": "elbow",
    "address": 4,
    "counts_per_turn": 200000,
    "output": "three_phase",
    "lower_deg": -120,
    "upper_deg": 5,
    "max_velocity_deg_s": 60,
    "max_acceleration_deg_s2": 240,
}
FILE = {"format": "nico-servos/1", "name": "arm", "joints": [JOINT]}


def written(tmp_path, content):
    path = tmp_path / "servos.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_the_sample_is_valid_and_about_nicos_right_arm(project_root):
    config = load_servo_config(project_root / "examples" / "nico_servos.yaml")
    arm = ArmDescription.named("nico", "right_arm")
    assert set(arm.chain.joints) <= set(config.joint_names)
    assert [joint.address for joint in config.joints] == [1, 2, 3, 4, 5, 6]
    assert config.baud == 115200


def test_a_configuration_is_read_in_degrees_and_kept_in_radians(tmp_path):
    joint = {
        **JOINT,
        "sign": -1,
        "gains": {"kp": 7, "rate_divisor": 2},
        "home": {"method": "limit_1", "at_deg": 90, "speed_deg_s": 5, "travel_deg": 200},
    }
    config = load_servo_config(
        written(tmp_path, {**FILE, "joints": [joint], "baud": 57600, "latency_ms": 16})
    )
    (servo,) = config.joints
    assert (servo.lower, servo.upper) == pytest.approx((math.radians(-120), math.radians(5)))
    assert servo.max_velocity == pytest.approx(math.radians(60))
    assert servo.gains == replace(Gains(), kp=7, rate_divisor=2)
    assert servo.home.at == pytest.approx(math.pi / 2)
    assert servo.register(100.0) == -100
    assert (config.baud, config.heartbeat, config.latency) == (57600, 0.3, 0.016)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"address": 0}, ("'address'", "1 to 127")),
        ({"address": 128}, ("'address'", "1 to 127")),
        ({"address": "four"}, ("'address'", "whole number")),
        ({"adress": 4}, ("'adress'", "did you mean 'address'")),
        ({"counts_per_turn": None}, ("'counts_per_turn' is missing",)),
        ({"counts_per_turn": -5}, ("'counts_per_turn' must be positive",)),
        ({"sign": 2}, ("'sign' must be 1 or -1",)),
        ({"output": "brushed"}, ("'output'", "three_phase", "one_pwm")),
        ({"output": None}, ("'output' is missing",)),
        ({"lower_deg": 10}, ("'lower_deg' must be less than 'upper_deg'",)),
        ({"lower_deg": ".nan"}, ("'lower_deg' must be a finite number",)),
        ({"upper_deg": 1e9}, ("position register",)),
        ({"max_velocity_deg_s": 0}, ("'max_velocity_deg_s'", "must be positive")),
        ({"max_velocity_deg_s": 1e-9}, ("'max_velocity_deg_s'", "a count a second")),
        ({"max_acceleration_deg_s2": 100}, ("'max_acceleration_deg_s2' must be at least 180",)),
        ({"max_velocity_deg_s": 1e7, "max_acceleration_deg_s2": 1e8}, ("cannot count that fast",)),
        ({"gains": {"kq": 5}}, ("gains", "'kq'")),
        ({"gains": {"error_limit": 20000}}, ("error_limit must be 1 to 16383",)),
        ({"gains": {"error_limit": 0}}, ("error_limit must be 1 to 16383, got 0",)),
        ({"gains": {"output_limit": 0}}, ("output_limit must be 1 to 255, got 0",)),
        (
            {"counts_per_turn": 500, "max_velocity_deg_s": 2, "max_acceleration_deg_s2": 10},
            ("'max_acceleration_deg_s2' must be at least 41.91", "rate_divisor"),
        ),
        (
            {"counts_per_turn": 500, "max_velocity_deg_s": 20, "max_acceleration_deg_s2": 62},
            ("it cannot stop in time", "must be at least 101.9"),
        ),
        ({"gains": 7}, ("mapping of gains",)),
        ({"home": {"method": "magic"}}, ("home 'method'", "limit_1")),
        ({"home": {"method": "index", "speed_deg_s": 5}}, ("'travel_deg'",)),
        ({"home": {"method": "index", "travel_deg": 5, "speed_deg_s": 90}}, ("at most 60",)),
        ({"home": {"method": "here", "at_deg": 1e9}}, ("'at_deg'", "less than a turn beyond")),
        (
            {"home": {"method": "index", "travel_deg": 1e9, "speed_deg_s": 9}},
            ("'travel_deg'", "a turn more than the joint's range"),
        ),
        ({"home": "here"}, ("'method' and 'at_deg'",)),
    ],
)
def test_a_mistake_in_a_joint_is_named_with_file_joint_and_key(change, words, tmp_path):
    path = written(tmp_path, {**FILE, "joints": [{**JOINT, **change}]})
    with pytest.raises(DataError) as caught:
        load_servo_config(path)
    for word in (str(path), "elbow", *words):
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "nico-servos/2"}, ("nico-servos/2", "nico-servos/1")),
        ({"joints": []}, ("'joints'",)),
        ({"joints": ["elbow"]}, ("joint 1", "mapping")),
        ({"joints": [JOINT, JOINT]}, ("'elbow' is given to two joints",)),
        ({"joints": [JOINT, {**JOINT, "name": "wrist"}]}, ("address 4 is given to two",)),
        ({"baud": 12345}, ("'baud'", "19200")),
        ({"heartbeat_s": 9}, ("'heartbeat_s' must be 0.1 to 2",)),
        ({"latency_ms": 0}, ("'latency_ms'",)),
        ({"name": None}, ("'name' is missing",)),
        ({"name": " "}, ("'name' must not be empty",)),
        ({"joints": [{**JOINT, "name": ""}]}, ("'name' must not be empty",)),
        ({"bauds": 5}, ("'bauds'",)),
    ],
)
def test_a_mistake_in_the_file_is_named(change, words, tmp_path):
    path = written(tmp_path, {**FILE, **change})
    with pytest.raises(DataError) as caught:
        load_servo_config(path)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DataError, match="nothing"):
        load_servo_config(tmp_path / "nothing.yaml")


def test_readings_become_joint_angles_through_the_self_model():
    config = configuration(("a", "b"))
    learned = ServoMap(
        ("b",), np.array([0.3]), np.array([1.1]), ("counts",), np.array([2e5]), np.array([-1.0])
    )
    both = config.servo_map(learned)
    assert both.joints == ("a", "b")
    q = np.array([0.2, -0.4])
    readings = both.to_encoder(q)
    assert readings[0] == pytest.approx(0.2 * COUNTS_PER_TURN / (2 * math.pi))
    assert readings[1] == pytest.approx(learned.to_encoder([-0.4])[0])


def test_a_self_model_in_radians_fits_any_encoder():
    config = configuration(("a",))
    learned = ServoMap(
        ("a",), np.array([0.1]), np.array([2.0]), ("rad",), np.array([np.nan]), np.array([1.0])
    )
    reading = config.servo_map(learned).to_encoder([0.5])[0]
    assert reading * 2 * math.pi / COUNTS_PER_TURN == pytest.approx(0.1 + 2.0 * 0.5)


def test_a_self_model_of_another_arm_is_refused():
    config = configuration(("a", "b"))
    one = np.ones(1)
    with pytest.raises(ValueError, match="other joints: neck is not among the servos \\(a, b\\)"):
        config.servo_map(ServoMap(("neck",), 0 * one, one, ("counts",), 2e5 * one, one))
    with pytest.raises(ValueError, match="8192 counts a turn, the servo configuration says 200000"):
        config.servo_map(ServoMap(("a",), 0 * one, one, ("counts",), 8192 * one, one))


def test_the_joints_are_what_a_data_set_says_of_them():
    config = configuration(("a",))
    (info,) = config.joint_infos
    assert (info.name, info.encoder_unit, info.counts_per_turn) == ("a", "counts", COUNTS_PER_TURN)
    assert info.upper == pytest.approx(COUNTS_PER_TURN / 4)


def test_a_joint_that_could_not_stop_in_time_is_refused():
    with pytest.raises(ValueError, match="cannot stop in time when the host goes silent"):
        JointServo("a", 1, 2e5, -1.0, 1.0, max_velocity=1.0, max_acceleration=2.9)
    JointServo("a", 1, 2e5, -1.0, 1.0, max_velocity=1.0, max_acceleration=3.0)


def test_the_sample_of_a_whole_nico_drives_all_its_joints_within_their_limits(project_root):
    config = load_servo_config(project_root / "examples" / "nico_whole_servos.yaml")
    body = looking_body()
    assert config.joint_names == body.joints
    half_a_degree = math.radians(0.5)
    for joint, lower, upper in zip(config.joints, body.lower, body.upper, strict=True):
        assert joint.lower == pytest.approx(lower, abs=half_a_degree)
        assert joint.upper == pytest.approx(upper, abs=half_a_degree)


@pytest.mark.parametrize(("divisor", "counts"), [(1, 58.21), (2, 5 * 14.552), (8, 91 * 0.9095)])
def test_a_board_accelerates_by_steps_that_a_coarse_encoder_shows(divisor, counts):
    joint = configuration(("elbow",)).joints[0]
    joint = replace(
        joint,
        counts_per_turn=500,
        gains=Gains(rate_divisor=divisor),
        max_velocity=math.radians(10),
        max_acceleration=math.radians(60),
    )
    asked = joint.max_acceleration * joint.counts_per_radian
    assert joint.largest_acceleration == pytest.approx(counts, rel=1e-3)
    assert asked - acceleration_step(divisor) < joint.largest_acceleration <= asked
