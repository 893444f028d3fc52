"""The calibration file of a lerobot arm, as a servo configuration."""

import json
import math

import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.servos import load_servo_config
from nico_selfmodel.servos.arm.lerobot_calibration import import_lerobot
from nico_selfmodel.servos.arm.servo_config_file import save_servo_config
from nico_selfmodel.servos.makes import FEETECH, PIC_SERVO

MOTOR = {"id": 1, "drive_mode": 0, "homing_offset": -1190, "range_min": 840, "range_max": 3048}
ARM = {
    "shoulder_pan": MOTOR,
    "elbow_flex": {**MOTOR, "id": 3, "drive_mode": 1, "homing_offset": 731},
    "wrist_roll": {**MOTOR, "id": 5, "range_min": 0, "range_max": 4095},
}
SPEED = math.radians(60)


def written(tmp_path, content):
    path = tmp_path / "follower.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_the_middle_of_the_range_is_zero_and_the_range_is_the_limits(tmp_path):
    config = import_lerobot(written(tmp_path, ARM), FEETECH, "follower", max_velocity=SPEED)
    pan, elbow, roll = config.joints
    assert [joint.address for joint in config.joints] == [1, 3, 5]
    assert (config.make, config.baud) == (FEETECH, 1_000_000)
    assert (pan.zero_counts, pan.homing_offset, pan.sign) == (1944, -1190, 1)
    # As lerobot has it: (value - middle) * 360 / 4096
    assert math.degrees(pan.lower) == pytest.approx(-1104 * 360 / 4096)
    assert pan.register(pan.lower_reading) == 840
    assert pan.register(pan.upper_reading) == 3048
    assert pan.reading(1944 + 512) == 512
    assert (elbow.sign, elbow.reading(1944 + 512)) == (-1, -512)
    assert sorted(map(elbow.register, (elbow.lower_reading, elbow.upper_reading))) == [840, 3048]
    assert roll.register(roll.upper_reading) - roll.register(roll.lower_reading) == 4095


def test_the_configuration_survives_its_file(tmp_path):
    config = import_lerobot(written(tmp_path, ARM), FEETECH, "follower", max_velocity=SPEED)
    save_servo_config(config, tmp_path / "servos.yaml")
    again = load_servo_config(tmp_path / "servos.yaml")
    assert again.make is config.make
    for one, other in zip(again.joints, config.joints, strict=True):
        assert (one.name, one.address, one.sign, one.zero_counts, one.homing_offset) == (
            *(other.name, other.address, other.sign, other.zero_counts, other.homing_offset),
        )
        assert one.lower == pytest.approx(other.lower)


def without(key):
    return {"elbow": {k: v for k, v in MOTOR.items() if k != key}}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[1]", ("expected an object",)),
        ("{}", ("expected an object",)),
        ("{", ("not valid JSON",)),
        ({"elbow": 5}, ("'elbow'", "range_min")),
        (without("range_min"), ("'elbow'", "'range_min' is missing")),
        ({"elbow": {**MOTOR, "id": "1"}}, ("'elbow'", "'id' must be a whole number")),
        ({"elbow": {**MOTOR, "id": 254}}, ("'elbow'", "'address' must be 0 to 253")),
        ({"elbow": {**MOTOR, "drive_mode": 2}}, ("'drive_mode' must be 0 or 1",)),
        ({"elbow": {**MOTOR, "range_max": 840}}, ("'range_min' must be less",)),
        ({"elbow": {**MOTOR, "range_max": 5000}}, ("position register", "0 to 4095")),
        ({"elbow": {**MOTOR, "rangemin": 1}}, ("'rangemin'", "did you mean")),
        ({"a": MOTOR, "b": MOTOR}, ("address 1 is given to two joints",)),
    ],
)
def test_a_mistake_is_named_with_file_motor_and_key(content, words, tmp_path):
    path = written(tmp_path, content)
    with pytest.raises(DataError) as caught:
        import_lerobot(path, FEETECH, "follower", max_velocity=SPEED)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_boards_are_no_lerobot_arm(tmp_path):
    with pytest.raises(ValueError, match="lerobot drives no PIC-SERVO boards"):
        import_lerobot(written(tmp_path, ARM), PIC_SERVO, "follower", max_velocity=SPEED)
