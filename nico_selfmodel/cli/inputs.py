"""What options name: loaded and checked before any work is done."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self, TypeVar

from nico_selfmodel.cli.option_groups import Bounds, Chain, HeldOut, HeldOutShare
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.names import LONGEST_NAME, check_name, listed, refuse_unknown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.dataset.body.body_dataset import BodyDataset
    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
    from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
    from nico_selfmodel.model.cameras.stereo_rig import StereoRig
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.plant import ArmDescription


class _Recording(Protocol):
    """Data sets of an arm, and of any body."""

    def split(self, fraction: float, seed: int, /) -> tuple[Self, Self]:
        """Return what to learn from, and what to hold out."""
        ...


_RecordingT = TypeVar("_RecordingT", bound=_Recording)
_DataT = TypeVar("_DataT")


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


def train_and_test(dataset: Path, held_out: HeldOut) -> "tuple[Dataset, Dataset | None]":
    """Load the training data, and what is held out of them or beside them.

    Raises:
        ValueError: If two ways of holding out are named, or the training data as test data.
        DataError: If a data set is not valid.
    """
    from nico_selfmodel.dataset.folder import content_hash, load_dataset

    return _train_and_test(dataset, held_out, load_dataset, content_hash)


def body_train_and_test(
    dataset: Path, held_out: HeldOut
) -> "tuple[BodyDataset, BodyDataset | None]":
    """Load the training data of any body, and what is held out of them or beside them.

    Raises:
        ValueError: If two ways of holding out are named, or the training data as test data.
        DataError: If a recording is not valid, or the two are of different bodies.
    """
    from nico_selfmodel.dataset.body.body_folder import body_content_hash, load_body_dataset

    train, test = _train_and_test(dataset, held_out, load_body_dataset, body_content_hash)
    return train, None if test is None else test.like(train)


def _train_and_test(
    dataset: Path,
    held_out: HeldOut,
    load: Callable[[Path], _RecordingT],
    hash_of: Callable[[_RecordingT], str],
) -> tuple[_RecordingT, _RecordingT | None]:
    _refuse_two_ways(held_out)
    train = load(dataset)
    if held_out.test_fraction is not None:
        return train.split(held_out.test_fraction, held_out.seed)
    return train, _test_beside(train, held_out, load, hash_of)


def steps_and_test(
    dataset: Path, held_out: HeldOut
) -> "tuple[MotionRecording, MotionRecording | None]":
    """Load a recording of steps, and what is held out beside it; shares are held out by step.

    Raises:
        ValueError: If two ways of holding out are named, or the training data as test data.
        DataError: If a recording is not valid.
    """
    from nico_selfmodel.dataset.motion.motion_folder import load_motion

    _refuse_two_ways(held_out)
    train = load_motion(dataset)
    return train, _test_beside(train, held_out, load_motion, lambda found: found.content_hash)


def _refuse_two_ways(held_out: HeldOut) -> None:
    if held_out.test is not None and held_out.test_fraction is not None:
        raise ValueError("give --test or --test-fraction, not both")


def _test_beside(
    train: _DataT,
    held_out: HeldOut,
    load: Callable[[Path], _DataT],
    hash_of: Callable[[_DataT], str],
) -> _DataT | None:
    """Load what `--test` names, if it does; refuse the training data."""
    if held_out.test is None:
        return None
    test = load(held_out.test)
    if hash_of(test) == hash_of(train):
        raise ValueError(
            f"--test {held_out.test} holds the training data: nothing would be held out"
        )
    return test


def refuse_untested(bounds: Bounds, held_out: HeldOutShare) -> None:
    """Refuse a bound on held-out data where none are held out: nothing could meet it.

    Raises:
        ValueError: If there is a bound, and nothing to hold against it.
    """
    beside = held_out.test if isinstance(held_out, HeldOut) else None
    if beside is not None or held_out.test_fraction is not None:
        return
    for unit, bound in (("mm", bounds.require_test_mm), ("px", bounds.require_test_px)):
        if bound is not None:
            raise ValueError(
                f"--require-test-{unit} is a bound on held-out data: give --test or --test-fraction"
            )


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
    if arms is None:
        return ()
    refuse_unknown("--arms", arms, _ARMS)
    return _ARMS[arms]


def cameras_of(path: Path | None) -> "StereoRig | None":
    """Load calibrated cameras, where they were named."""
    model = model_of(path)
    return None if model is None else model.rig


def poses_of(path: Path | None, joints: tuple[str, ...]) -> "NDArray | None":
    """Load a table of readings to go to, where one was named. Shape (n, joints)."""
    from nico_selfmodel.dataset.csv_table import CsvTable
    from nico_selfmodel.dataset.readings import readings_from_table

    return None if path is None else readings_from_table(CsvTable.read(path), joints)


def chosen_arm(chain: Chain) -> "ArmDescription":
    """Return the chain that the options name, of a robot that is named.

    Raises:
        ModelError: If it does not exist.
        ValueError: If options contradict each other or a value is no number.
    """
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.plant.robots import ROBOTS

    robot = chain.robot or "nico"
    if robot in ROBOTS and chain.base is None and chain.tip is None:
        if chain.hold or chain.point:
            raise ValueError("--hold and --point need --base and --tip")
        return ArmDescription.named(robot, chain.arm)
    if chain.arm is not None:
        given = chain.base is not None or chain.tip is not None
        raise ValueError(
            "--arm names a chain of a named robot: "
            + ("leave out --base and --tip" if given else "give --base and --tip of a URDF")
        )
    points = dict(name_and_value(word, "--point") for word in chain.point or [])
    return ArmDescription.from_urdf(robot, chain.base, chain.tip, _held(chain.hold), points or None)


def described_arm(chain: Chain) -> "tuple[ArmDescription | None, NominalArm | None]":
    """Return the robot that the data are of, where one was named, and its nominal arm.

    Raises:
        ModelError: If it does not exist.
        ValueError: If options contradict each other.
    """
    if chain.robot is None:
        if chain.names_a_part:
            raise ValueError("--arm, --base, --tip, --hold and --point need --robot")
        return None, None
    from nico_selfmodel.sessions.motion_capture_scenario import nominal_of

    description = chosen_arm(chain)
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
