"""A robot that learns its own body by watching it move.

What scripts need is here (`from nico_selfmodel import calibrate_kinematics, judge`); what a Drake
diagram is composed of is in `nico_selfmodel.systems`, `nico_selfmodel.plant` and
`nico_selfmodel.servos`. Names are loaded when first asked for (PEP 562), so that `import
nico_selfmodel` costs nothing.
"""

from nico_selfmodel.lazy import lazy_names

TYPE_CHECKING = False  # for readers of types; `typing` itself takes longer to load than all of this
if TYPE_CHECKING:
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.dataset.folder import load_dataset, save_dataset
    from nico_selfmodel.dataset.importers.csv_importer import import_csv
    from nico_selfmodel.dataset.joint_info import JointInfo
    from nico_selfmodel.dataset.motion.motion_folder import load_motion
    from nico_selfmodel.estimation.arm.evaluation import evaluate
    from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
    from nico_selfmodel.estimation.body.body import calibrate_body
    from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
    from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.mirrors.mirror import calibrate_mirrors
    from nico_selfmodel.estimation.monitoring.health import check_health
    from nico_selfmodel.estimation.monitoring.tool import calibrate_tool, rezero
    from nico_selfmodel.estimation.response.servo_calibration import calibrate_servos
    from nico_selfmodel.estimation.tree.body_prediction import predict_body
    from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
    from nico_selfmodel.estimation.tree.tree_result import body_model
    from nico_selfmodel.model.cameras.mirror import Mirror
    from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
    from nico_selfmodel.model.response.servo_response import load_responses
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.model.self_model_file import load_model, save_model
    from nico_selfmodel.model.shape.shape_folder import load_shape
    from nico_selfmodel.model.tree.body_model import load_body, save_body
    from nico_selfmodel.planning.mirror_view import MirrorView
    from nico_selfmodel.planning.plans import commands_of_angles
    from nico_selfmodel.planning.sweep_protocol import SweepProtocol
    from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
    from nico_selfmodel.recording.session import record
    from nico_selfmodel.sessions.gazing import look_at
    from nico_selfmodel.sessions.simulated_session import simulated_session
    from nico_selfmodel.vision.images.not_seen import NotSeen

__version__ = "0.1.0"

__all__ = [
    "Dataset",
    "JointInfo",
    "Mirror",
    "MirrorRig",
    "MirrorView",
    "NominalArm",
    "NotSeen",
    "SelfModel",
    "SweepProtocol",
    "VisibleWorkspace",
    "body_model",
    "calibrate_body",
    "calibrate_cameras",
    "calibrate_kinematics",
    "calibrate_mirrors",
    "calibrate_servos",
    "calibrate_tool",
    "calibrate_tree",
    "check_health",
    "commands_of_angles",
    "evaluate",
    "import_csv",
    "judge",
    "load_body",
    "load_body_dataset",
    "load_dataset",
    "load_model",
    "load_motion",
    "load_responses",
    "load_shape",
    "look_at",
    "predict_body",
    "record",
    "rezero",
    "save_body",
    "save_dataset",
    "save_model",
    "simulated_session",
    "to_json",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "dataset.body.body_folder": ("load_body_dataset",),
        "dataset.dataset": ("Dataset",),
        "dataset.folder": ("load_dataset", "save_dataset"),
        "dataset.importers.csv_importer": ("import_csv",),
        "dataset.joint_info": ("JointInfo",),
        "dataset.motion.motion_folder": ("load_motion",),
        "estimation.arm.evaluation": ("evaluate",),
        "estimation.arm.kinematics": ("calibrate_kinematics",),
        "estimation.body.body": ("calibrate_body",),
        "estimation.cameras.camera_calibration": ("calibrate_cameras",),
        "estimation.initialization.nominal_arm": ("NominalArm",),
        "estimation.judging": ("judge", "to_json"),
        "estimation.mirrors.mirror": ("calibrate_mirrors",),
        "estimation.monitoring.health": ("check_health",),
        "estimation.monitoring.tool": ("calibrate_tool", "rezero"),
        "estimation.response.servo_calibration": ("calibrate_servos",),
        "estimation.tree.body_prediction": ("predict_body",),
        "estimation.tree.tree_calibration": ("calibrate_tree",),
        "estimation.tree.tree_result": ("body_model",),
        "model.cameras.mirror": ("Mirror",),
        "model.cameras.mirror_rig": ("MirrorRig",),
        "model.response.servo_response": ("load_responses",),
        "model.self_model": ("SelfModel",),
        "model.self_model_file": ("load_model", "save_model"),
        "model.shape.shape_folder": ("load_shape",),
        "model.tree.body_model": ("load_body", "save_body"),
        "planning.mirror_view": ("MirrorView",),
        "planning.plans": ("commands_of_angles",),
        "planning.sweep_protocol": ("SweepProtocol",),
        "planning.visible_workspace": ("VisibleWorkspace",),
        "recording.session": ("record",),
        "sessions.gazing": ("look_at",),
        "sessions.simulated_session": ("simulated_session",),
        "vision.images.not_seen": ("NotSeen",),
    },
)
