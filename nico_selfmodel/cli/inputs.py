"""What options name: loaded and checked before any work is done."""

from pathlib import Path
from typing import TYPE_CHECKING

from nico_selfmodel.files.reading import real_path
from nico_selfmodel.names import LONGEST_NAME, check_name, listed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
    from nico_selfmodel.model.cameras.stereo_rig import StereoRig
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.vision.boards.board_detection import AnyBoard


def name_after(path: Path) -> str:
    """Return what something is called that has no name of its own: what its folder is called.

    Raises:
        ValueError: If that is no name.
    """
    name = real_path(path).name[:LONGEST_NAME].strip()
    check_name(name, f"the name of {path}, by which it would be called,")
    return name


def beside(path: Path, ending: str) -> Path:
    """Return a path beside another that does not exist yet, to be suggested: `data_relearned`.

    Args:
        path: What is there.
        ending: What its name goes on with.
    """
    if path.name in ("", ".."):
        path = real_path(path)
    name = f"{path.name.removesuffix('.csv')}_{ending}"
    made, number = path.with_name(name), 1
    while made.exists():
        number += 1
        made = path.with_name(f"{name}_{number}")
    return made


def train_and_test(
    dataset: Path, test: Path | None, fraction: float | None, seed: int
) -> "tuple[Dataset, Dataset | None]":
    """Load the training data, and what is held out of them or beside them.

    Raises:
        ValueError: If two ways of holding out are named, or the training data as test data.
        DataError: If a data set is not valid.
    """
    from nico_selfmodel.dataset.folder import content_hash, load_dataset

    if test is not None and fraction is not None:
        raise ValueError("give --test or --test-fraction, not both")
    train = load_dataset(dataset)
    if fraction is not None:
        return train.split(fraction, seed)
    if test is None:
        return train, None
    held_out = load_dataset(test)
    refuse_training_data(test, content_hash(held_out), content_hash(train))
    return train, held_out


def refuse_untested(
    require_test_mm: float | None, require_test_px: float | None, *held_out: object
) -> None:
    """Refuse a bound on held-out data where none are held out: nothing could meet it.

    Args:
        require_test_mm: Bound in space, if one was given.
        require_test_px: Bound in the images, if one was given.
        held_out: What was given of ways to hold data out; None for what was not.

    Raises:
        ValueError: If there is a bound, and nothing to hold against it.
    """
    if any(way is not None for way in held_out):
        return
    for unit, bound in (("mm", require_test_mm), ("px", require_test_px)):
        if bound is not None:
            raise ValueError(
                f"--require-test-{unit} is a bound on held-out data: give --test or --test-fraction"
            )


def refuse_training_data(test: Path, held_out: str, train: str) -> None:
    """Refuse test data that are the training data, by the hashes of both.

    Raises:
        ValueError: If they are the same.
    """
    if held_out == train:
        raise ValueError(f"--test {test} holds the training data: nothing would be held out")


def board(text: str, square_mm: float, tag_mm: float | None, family: str | None) -> "AnyBoard":
    """Return the board that `--board`, `--square-mm`, `--tag-mm` and `--family` name."""
    from nico_selfmodel.vision.boards.board_kinds import board_of

    return board_of(text, square_mm, tag_mm, family)


def model_of(path: Path | None) -> "SelfModel | None":
    """Load a self-model, where one was named."""
    from nico_selfmodel.model.self_model_file import load_model

    return None if path is None else load_model(path)


_ARMS = {"right": ("right",), "left": ("left",), "both": ("right", "left")}


def arms_named(arms: str | None) -> tuple[str, ...]:
    """Return the whole arms that were named; none if none were.

    Raises:
        ValueError: If there are no such arms.
    """
    if arms is not None and arms not in _ARMS:
        raise ValueError(f"--arms must be one of {', '.join(_ARMS)}, got {arms!r}")
    return () if arms is None else _ARMS[arms]


def cameras_of(path: Path | None, what: str) -> "StereoRig | None":
    """Load calibrated cameras, where they were named; `what` is done with them, for errors.

    Raises:
        ModelError: If their lenses are no polynomials.
    """
    from nico_selfmodel.model.cameras.camera import require_polynomial
    from nico_selfmodel.model.self_model_file import load_model

    if path is None:
        return None
    rig = load_model(path).rig
    require_polynomial(rig.cameras, what)
    return rig


def poses_of(path: Path | None, joints: tuple[str, ...]) -> "NDArray | None":
    """Load a table of readings to go to, where one was named. Shape (n, joints)."""
    from nico_selfmodel.files.reading import LARGEST_TABLE, read_text
    from nico_selfmodel.model.readings import readings_from_table

    if path is None:
        return None
    return readings_from_table(read_text(path, LARGEST_TABLE), joints, str(path))


def chosen_arm(
    robot: str,
    arm: str | None,
    base: str | None,
    tip: str | None,
    hold: list[str] | None,
    point: list[str] | None,
) -> "ArmDescription":
    """Return the chain that the options name.

    Raises:
        ModelError: If it does not exist.
        ValueError: If options contradict each other or a value is no number.
    """
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.plant.robots import ROBOTS

    if robot in ROBOTS and base is None and tip is None:
        if hold or point:
            raise ValueError("--hold and --point need --base and --tip")
        return ArmDescription.named(robot, arm)
    if arm is not None:
        raise ValueError("--arm names a chain of a named robot: leave out --base and --tip")
    points = dict(name_and_value(word, "--point") for word in point or [])
    return ArmDescription.from_urdf(robot, base, tip, _held(hold), points or None)


def described_arm(
    robot: str | None,
    arm: str | None,
    base: str | None,
    tip: str | None,
    hold: list[str] | None,
    point: list[str] | None,
) -> "tuple[ArmDescription | None, NominalArm | None]":
    """Return the robot that the data are of, where one was named, and its nominal arm.

    Raises:
        ModelError: If it does not exist.
        ValueError: If options contradict each other.
    """
    if robot is None:
        if any((arm, base, tip, hold, point)):
            raise ValueError("--arm, --base, --tip, --hold and --point need --robot")
        return None, None
    from nico_selfmodel.sessions.motion_capture_scenario import nominal_of

    description = chosen_arm(robot, arm, base, tip, hold, point)
    return description, nominal_of(description)


def check_points(point: list[str] | None, markers: tuple[str, ...]) -> None:
    """Refuse a `--point` for a marker that the data do not track.

    Raises:
        ValueError: If there is one; the message lists the markers of the data.
    """
    for word in point or []:
        marker = name_and_value(word, "--point")[0]
        if marker not in markers:
            raise ValueError(
                f"--point {word}: the data set tracks no {marker!r}; it tracks "
                f"{listed(markers, marker)}"
            )


def _held(words: list[str] | None) -> dict[str, float]:
    from nico_selfmodel.files.csv_rows import number_of_word

    held = {}
    for word in words or []:
        joint, equals, value = word.partition("=")
        held[joint] = number_of_word(value, f"--hold {word}") if equals else 0.0
    return held


def name_and_value(word: str, option: str) -> tuple[str, str]:
    """Return both sides of what an option was given as NAME=VALUE.

    Raises:
        ValueError: If one is missing.
    """
    name, equals, value = word.partition("=")
    if not (name and equals and value):
        raise ValueError(f"{option} {word}: expected NAME=VALUE")
    return name, value
