"""Every block of docs/any-robot.md runs as it stands there, for a robot that nobody knows."""

import re
import shutil
import subprocess
import sys

import pytest

from nico_selfmodel.plant import add_directives

LINES = 40


@pytest.fixture(scope="module")
def blocks(project_root):
    """Return name -> code of the document's Python blocks."""
    text = (project_root / "docs" / "any-robot.md").read_text(encoding="utf-8")
    found = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", text, re.DOTALL)
    assert len(found) == text.count("```python")
    return dict(found)


@pytest.fixture(scope="module")
def folder(blocks, project_root, tmp_path_factory):
    """Return a folder that holds the blocks as files, and the robot's description."""
    made = tmp_path_factory.mktemp("any_robot")
    for name, code in blocks.items():
        (made / name).write_text(code, encoding="utf-8")
    shutil.copy(project_root / "examples" / "six_axis.urdf", made)
    return made


@pytest.fixture(scope="module")
def run(folder, project_root):
    def run_block(name):
        code = f"import sys; sys.path.insert(0, {str(project_root)!r}); sys.path.insert(0, '.')\n"
        code += f"exec(compile(open({name!r}).read(), {name!r}, 'exec'))"
        done = subprocess.run(
            [sys.executable, "-W", "error::DeprecationWarning", "-c", code],
            capture_output=True,
            text=True,
            cwd=folder,
            timeout=240,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return run_block


@pytest.fixture(scope="module")
def learned(run):
    return run("learn.py")


def test_a_description_tells_its_joints_and_what_is_tracked(run):
    lines = run("describe.py")
    assert lines[2] == "elbow from -3.14 to 3.14 rad"
    assert lines[-1] == "tracked: {'hand': 'tool0'}"


def test_a_new_robot_takes_forty_lines(blocks):
    lines = [line for line in blocks["learn.py"].splitlines() if line.strip()]
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= 100


@pytest.mark.slow
def test_a_new_robot_is_recorded_learned_and_monitored(learned):
    result, healthy, knocked = learned
    assert result.startswith("PASS")
    assert 0.05 < float(result.split()[1]) < 0.5
    assert healthy == "day 3 fits"
    assert knocked == "day 4 zero of elbow"


@pytest.mark.slow
def test_the_learned_robot_moves_in_a_plant_of_ones_own(learned, run):
    agreement, derivatives = run("use.py")
    assert float(agreement.split()[-2]) < 1e-9
    assert derivatives == "derivatives of 6 positions"


@pytest.mark.slow
def test_a_body_of_two_arms_is_learned_in_a_dozen_lines(project_root, folder, run):
    example = project_root / "examples" / "15_two_arms_two_cameras.py"
    subprocess.run([sys.executable, str(example), "two_arms"], cwd=folder, check=True)
    verdict, place = run("two_arms.py")
    assert verdict.startswith("PASS 0.4")
    assert place.startswith("left_tag0 at [0.381 0.293 1.443] m, known to 0.")


@pytest.mark.slow
def test_the_directives_of_the_document_are_read(project_root, folder, learned):
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    text = (project_root / "docs" / "any-robot.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```yaml\n( *directives:.*?)```", text, re.DOTALL)
    (folder / "scene.yaml").write_text(block.replace("my_result", "self_model.yaml"))
    for name, link in (("table", "top"), ("gripper", "base")):
        (folder / f"{name}.urdf").write_text(f'<robot name="{name}"><link name="{link}"/></robot>')
    plant = MultibodyPlant(1e-3)
    robots = add_directives(folder / "scene.yaml", Parser(plant))
    plant.Finalize()
    assert list(robots) == ["arm"]
    assert plant.num_positions() == 6
