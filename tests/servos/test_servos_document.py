"""What docs/servos.md shows of a Dynamixel arm is what happens, from `servo scan` to `monitor`."""

import os
import re
import subprocess
import sys

import pytest

from nico_selfmodel.servos import load_servo_config

TRIES = 3
"""A busy machine may let the simulated servos starve; a recording goes on where it ended."""
CODE = "from nico_selfmodel.cli.main import main; main()"


def block(project_root, title):
    """Return the fenced block under a comment of the document."""
    text = (project_root / "docs" / "servos.md").read_text(encoding="utf-8")
    return re.search(rf"<!-- {title} -->\n```\w+\n(.*?)```", text, re.DOTALL).group(1)


def test_the_configuration_of_the_chapter_is_one(project_root, tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(block(project_root, "dynamixel configuration"))
    config = load_servo_config(path)
    assert config.make.name == "dynamixel"
    assert [joint.zero_counts for joint in config.joints] == [2048, 1024]
    path.write_text(path.read_text().replace("make: dynamixel", "make: feetech"))
    assert load_servo_config(path).make.name == "feetech"


@pytest.mark.slow
def test_the_commands_of_the_chapter_learn_an_arm_and_find_it_well(project_root, tmp_path):
    pytest.importorskip("dynamixel_sdk")
    lines = [
        line.split("#")[0].split() for line in block(project_root, "dynamixel chapter").splitlines()
    ]
    (program, *first), *others = lines
    assert program == "nico-selfmodel"
    path = os.pathsep.join([str(project_root), os.environ.get("PYTHONPATH", "")])
    options = {
        "cwd": tmp_path,
        "env": {**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"},
        "stdout": subprocess.PIPE,
        "text": True,
    }
    words = [sys.executable, "-c", CODE]
    with subprocess.Popen([*words, *first], **options) as simulation:
        try:
            said = dict(simulation.stdout.readline().split(maxsplit=1) for _ in range(3))
            ports = {"SERVOS": said["servos"].strip(), "TRACKER": said["motion-capture"].strip()}
            shown = []
            for line in others:
                command = [ports.get(word, word) for word in line[1:]]
                for _ in range(TRIES):
                    done = subprocess.run(
                        [*words, *command],
                        **options,
                        stderr=subprocess.STDOUT,
                        timeout=540,
                        check=False,
                    )
                    if "the same command goes on from there" not in done.stdout:
                        break
                assert done.returncode == 0, (command, done.stdout)
                shown.append(done.stdout)
        finally:
            simulation.kill()
    assert shown[0].count("XM430-W350") == 4
    assert re.search(r"right_elbow at -(29\.9|30\.0)", shown[2])
    assert (tmp_path / "arm" / "self_model.yaml").is_file()
