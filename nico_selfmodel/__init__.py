"""A robot that learns its own body by watching it move.

What scripts need is here (`from nico_selfmodel import calibrate_kinematics, judge`); what a Drake
diagram is composed of is in `nico_selfmodel.systems`, `nico_selfmodel.plant` and
`nico_selfmodel.servos`. Names are loaded when first asked for (PEP 562), so that `import
nico_selfmodel` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.dataset.folder import load_dataset, save_dataset
    from nico_selfmodel.dataset.importers.csv_importer import import_csv
    from nico_selfmodel.dataset.joint_info import JointInfo
    from nico_selfmodel.estimation.arm.evaluation import evaluate
    from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
    from nico_selfmodel.estimation.body.body import calibrate_body
    from nico_selfmodel.estimation.cameras.stereo import calibrate_cameras
    from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
    from nico_selfmodel.estimation.monitoring.health import check_health
    from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, rezero
    from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.model.self_model_file import load_model, save_model
    from nico_selfmodel.planning.mirror_view import MirrorView
    from nico_selfmodel.planning.plans import commands_of_angles
    from nico_selfmodel.planning.sweep_protocol import SweepProtocol
    from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
    from nico_selfmodel.recording.session import record
    from nico_selfmodel.sessions.simulated_session import simulated_session
    from nico_selfmodel.vision.images.not_seen import NotSeen

__version__ = "0.1.0"

_HOMES = {
    "dataset.dataset": ("Dataset",),
    "dataset.folder": ("load_dataset", "save_dataset"),
    "dataset.importers.csv_importer": ("import_csv",),
    "dataset.joint_info": ("JointInfo",),
    "estimation.arm.evaluation": ("evaluate",),
    "estimation.arm.kinematics": ("calibrate_kinematics",),
    "estimation.body.body": ("calibrate_body",),
    "estimation.cameras.stereo": ("calibrate_cameras",),
    "estimation.initialization.nominal_arm": ("NominalArm",),
    "estimation.judging": ("judge", "to_json"),
    "estimation.mirrors.mirror": ("calibrate_mirrors",),
    "estimation.monitoring.health": ("check_health",),
    "estimation.monitoring.tool": ("calibrate_tool", "rezero"),
    "model.cameras.mirror_rig": ("MirrorRig",),
    "model.self_model": ("SelfModel",),
    "model.self_model_file": ("load_model", "save_model"),
    "planning.mirror_view": ("MirrorView",),
    "planning.plans": ("commands_of_angles",),
    "planning.sweep_protocol": ("SweepProtocol",),
    "planning.visible_workspace": ("VisibleWorkspace",),
    "recording.session": ("record",),
    "sessions.simulated_session": ("simulated_session",),
    "vision.images.not_seen": ("NotSeen",),
}
"""Module -> the names that are loaded from it."""
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Dataset",
    "JointInfo",
    "MirrorRig",
    "MirrorView",
    "NominalArm",
    "NotSeen",
    "SelfModel",
    "SweepProtocol",
    "VisibleWorkspace",
    "calibrate_body",
    "calibrate_cameras",
    "calibrate_kinematics",
    "calibrate_mirrors",
    "calibrate_tool",
    "check_health",
    "commands_of_angles",
    "evaluate",
    "import_csv",
    "judge",
    "load_dataset",
    "load_model",
    "record",
    "rezero",
    "save_dataset",
    "save_model",
    "simulated_session",
    "to_json",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names."""
    return [*__all__, "__version__"]
