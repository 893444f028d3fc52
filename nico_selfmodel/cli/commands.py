"""What commands there are; modules of those that words do not name are not loaded."""

from collections.abc import Callable, Sequence
from types import ModuleType

Commands = dict[str, Callable[..., None]]
"""Name -> what it does."""


_OF_ALL = ("--help", "--version")
"""What is asked of no command."""


def _called(*modules: ModuleType) -> Commands:
    """Return the command of each module, a function that is called as the module is."""
    names = [module.__name__.rpartition(".")[2] for module in modules]
    found = (getattr(module, name) for module, name in zip(modules, names, strict=True))
    return {name.replace("_", "-"): command for name, command in zip(names, found, strict=True)}


def _alone() -> Commands:
    """Return the commands that are in no group."""
    from nico_selfmodel.cli import (
        choose_poses,
        convert,
        detect,
        evaluate,
        export_urdf,
        gaze,
        join,
        live,
        locate,
        look,
        monitor,
        pick_color,
        predict,
        rezero,
        view,
    )
    from nico_selfmodel.cli.learn import learn
    from nico_selfmodel.cli.record import record

    return _called(
        *(learn, record, evaluate, monitor, rezero, predict, gaze, choose_poses, convert, join),
        *(export_urdf, locate, look, view, live, detect, pick_color),
    )


def _simulate() -> Commands:
    from nico_selfmodel.cli import simulate

    return {"motion-capture": simulate.motion_capture, "whole-body": simulate.whole_body}


def _import() -> Commands:
    from nico_selfmodel.cli import cameras_files, import_csv, import_lerobot, import_vicon

    return {
        "csv": import_csv.from_csv,
        "vicon": import_vicon.from_vicon,
        "lerobot": import_lerobot.from_lerobot,
        "cameras": cameras_files.import_cameras,
    }


def _export() -> Commands:
    from nico_selfmodel.cli import cameras_files

    return {"cameras": cameras_files.export_cameras}


def _calibrate() -> Commands:
    from nico_selfmodel.cli.calibrate import (
        body,
        camera,
        cameras,
        hand_eye,
        kinematics,
        mirror,
        servos,
        shape,
        stereo,
        tool,
    )

    return _called(kinematics, cameras, stereo, camera, body, hand_eye, tool, mirror, shape, servos)


def _experiment() -> Commands:
    from nico_selfmodel.cli.experiment import (
        mirror,
        mirror_test,
        motion_capture,
        refinement,
        stereo,
        tool,
        vision,
    )

    return _called(stereo, motion_capture, vision, refinement, tool, mirror, mirror_test)


def _markers() -> Commands:
    from nico_selfmodel.cli import markers

    return {"sheet": markers.sheet, "board": markers.board}


def _servo() -> Commands:
    from nico_selfmodel.cli.servo import home, move, scan, serve, simulate, status, steps, stop

    return _called(scan, status, move, steps, home, stop, serve, simulate)


def _hand() -> Commands:
    from nico_selfmodel.cli import hand

    return {"open": hand.open_hand, "close": hand.close_hand}


_GROUPS: dict[str, tuple[str, Callable[[], Commands]]] = {
    "simulate": ("Record data of a simulated body.", _simulate),
    "import": ("Import data, cameras or servos from files made elsewhere.", _import),
    "export": ("Write what was learned for other programs.", _export),
    "calibrate": ("Learn a self-model from recorded data.", _calibrate),
    "experiment": ("Run an experiment of the thesis.", _experiment),
    "markers": ("Fiducial markers and boards to print.", _markers),
    "servo": ("Drive the real servos.", _servo),
    "hand": ("Open and close the hand.", _hand),
}


ORDER = (
    *("learn", "record", "simulate", "import", "convert", "join", "choose-poses"),
    *("calibrate", "evaluate", "monitor", "rezero"),
    *("predict", "gaze", "locate", "look", "view", "live", "export-urdf", "export"),
    *("detect", "pick-color", "markers", "servo", "hand", "experiment"),
)
"""How help lists them: data, what learns from them, what uses that, tools."""


def commands_named(words: Sequence[str]) -> tuple[Commands, dict[str, tuple[str, Commands]]]:
    """Return the commands, and the groups of them, that are asked for.

    Returns:
        Commands, and group -> what it is for and its commands: what the first words name alone;
        groups without what is in them where only they are told; else all that there is.
    """
    first, second = [*words, "", ""][:2]
    if first in _GROUPS:
        text, load = _GROUPS[first]
        return {}, {first: (text, _only(second, load()))}
    alone = _alone()
    if first in alone:
        return _only(first, alone), {}
    groups = {}
    for name, (text, load) in _GROUPS.items():
        groups[name] = (text, {} if first in _OF_ALL else load())
    return alone, groups


def _only(name: str, commands: Commands) -> Commands:
    return {name: commands[name]} if name in commands else commands
