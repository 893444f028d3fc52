"""Every argument and option that two commands share, declared once."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.names import check_name, listed


def _name(param: typer.CallbackParam, value: str | None) -> str | None:
    if value is not None:
        check_name(value, param.opts[-1])
    return value


def _positive(param: typer.CallbackParam, value: float | None) -> float | None:
    if value is not None and not 0.0 < value < float("inf"):
        raise ValueError(f"{param.opts[-1]} must be a positive number, got {value:g}")
    return value


def _square_mm(param: typer.CallbackParam, value: float | None) -> float | None:
    if value is not None and 0.0 < value < 0.5:
        raise ValueError(
            f"{param.opts[-1]} {value:g}: squares of {value:g} mm are hardly seen; if these are "
            f"metres, give {1e3 * value:g}"
        )
    return _positive(param, value)


def _share(param: typer.CallbackParam, value: float | None) -> float | None:
    if value is not None and not 0.0 < value < 1.0:
        raise ValueError(
            f"{param.opts[-1]} must lie between 0 and 1, both exclusive, got {value:g}"
        )
    return value


def refuse_given(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Refuse options that a command has and what it was given does not use.

    Args:
        names: Of the options' parameters.
        why: What they do not go with.

    Raises:
        ValueError: If one was given on the command line.
    """
    words = {param.name: param.opts[-1] for param in context.command.params}
    given = [
        words[name]
        for name in names
        if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"
    ]
    if given:
        raise ValueError(f"{listed(given)} would change nothing: {why}")


# What is read.
_MODEL = "self_model.yaml, or a result folder."
Model = Annotated[Path, typer.Argument(help=_MODEL)]
KnownModel = Annotated[Path, typer.Option("--model", help=_MODEL)]
KnownModelOrNone = Annotated[Path | None, typer.Option("--model", help=_MODEL)]
ModelOrNominal = Annotated[
    Path | None, typer.Option("--model", help=f"{_MODEL[:-1]}; nominal if omitted.")
]
Dataset = Annotated[Path, typer.Argument(help="Folder of a data set.")]
Datasets = Annotated[
    list[Path], typer.Argument(help="Folders of data sets, or folders that hold some.")
]
ImagesOrNone = Annotated[
    Path | None, typer.Argument(help="Folder of photographs of a board, left* and right*.")
]
Cameras = Annotated[
    Path | None,
    typer.Option("--cameras", help="Calibrated cameras: a result of `calibrate stereo`."),
]
KnownCameras = Annotated[
    Path | None,
    typer.Option("--known", help="Self-model with these cameras as they were, to be compared."),
]
Test = Annotated[
    Path | None, typer.Option("--test", help="Held-out data: a folder like that of the training.")
]
TestFraction = Annotated[
    float | None,
    typer.Option(
        "--test-fraction", help="Share of the data to hold out, such as 0.3.", callback=_share
    ),
]

# What is written.
Out = Annotated[Path, typer.Option("--out", help="Folder to make.")]
OutFile = Annotated[Path, typer.Option("--out", help="File to make.")]
OutPage = Annotated[
    Path | None, typer.Option("--out", help="HTML page to make, in place of a server that runs on.")
]
NoReport = Annotated[
    bool, typer.Option("--no-report", help="Leave out report, residuals and scene.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace what --out names.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ModelName = Annotated[
    str | None, typer.Option("--name", help="Name of the self-model.", callback=_name)
]
DatasetName = Annotated[
    str | None, typer.Option("--name", help="Name of the data set.", callback=_name)
]

# Who does many jobs.
Processes = Annotated[int, typer.Option("--processes", min=1, help="How many are done at once.")]
Dask = Annotated[
    str | None,
    typer.Option(
        "--dask", metavar="ADDRESS", help="Do them on the Dask cluster of this scheduler: tcp://..."
    ),
]

# How it is learned.
Fix = Annotated[
    list[str] | None,
    typer.Option(
        "--fix",
        metavar="NAME[=VALUE]",
        help="Fix a parameter, named as in result.json. Repeat for more.",
    ),
]
Free = Annotated[
    list[str] | None,
    typer.Option(
        "--free", metavar="NAME", help="Estimate a parameter that is fixed. Repeat for more."
    ),
]
Prior = Annotated[
    list[str] | None,
    typer.Option(
        "--prior", metavar="NAME=MEAN,SIGMA", help="What is known of a parameter. Repeat for more."
    ),
]
Tangential = Annotated[
    bool, typer.Option("--tangential", help="Estimate tangential distortion p1, p2.")
]
Lens = Annotated[
    str,
    typer.Option(
        "--lens",
        help="What bends light: polynomial (k1 to k3), rational (k1 to k6), fisheye, or auto: what "
        "boards that were left out gain from. Of cameras that differ: left=fisheye,right=rational.",
    ),
]
FixedAspect = Annotated[bool, typer.Option("--fixed-aspect", help="Hold fx and fy equal.")]
Effects = Annotated[
    str,
    typer.Option(
        "--effects",
        help="What may bend: auto, none, or some of sag,bearing_sag,backlash,ripple,gear,"
        "coupling. Each is "
        "kept only where unseen poses gain.",
    ),
]
Up = Annotated[
    str | None,
    typer.Option("--up", help="The vertical in the data's frame, such as 0,0,1; for sag."),
]
Loss = Annotated[
    str,
    typer.Option(
        "--loss", help="trimmed, none, huber, cauchy or tukey; of bodies trimmed or none."
    ),
]
SplitSeed = Annotated[
    int, typer.Option("--seed", min=0, help="Random seed: what is held out, random starts.")
]
DataSensor = Annotated[str, typer.Option("--sensor", help="What to go by: auto, pixels or points.")]
Count = Annotated[int, typer.Option("--count", min=1, help="How many poses.")]
Marker = Annotated[str | None, typer.Option("--marker", help="Name of the tracked point.")]
RequireTestMm = Annotated[
    float | None,
    typer.Option(
        "--require-test-mm",
        help="FAIL where the mean held-out error is larger [mm].",
        callback=_positive,
    ),
]
RequireTestPx = Annotated[
    float | None,
    typer.Option(
        "--require-test-px",
        help="FAIL where the mean held-out error is larger [px].",
        callback=_positive,
    ),
]

# Chessboards and pixels.
_BOARD = typer.Option(
    "--board",
    metavar="[KIND:]COLSxROWS",
    help="Inner corners of a chessboard, as 9x6, or another board: charuco:7x5 (inner corners), "
    "aprilgrid:6x6 (tags), circles:7x5, asymmetric-circles:4x11.",
)
_WINDOW = typer.Option("--window", min=2, help="Half side of a corner's sub-pixel window [px].")
Board = Annotated[str, _BOARD]
BoardOrNone = Annotated[str | None, _BOARD]
SquareMm = Annotated[
    float,
    typer.Option(
        "--square-mm",
        help="Side of a square; of tags and circles, their distance.",
        callback=_square_mm,
    ),
]
TagMm = Annotated[
    float | None,
    typer.Option(
        "--tag-mm", help="Side of a board's tags, diameter of its circles.", callback=_square_mm
    ),
]
Window = Annotated[int, _WINDOW]
WindowOrNone = Annotated[int | None, _WINDOW]
Family = Annotated[
    str | None,
    typer.Option(
        "--family",
        help="Of fiducial markers; apriltag_36h11 by default, of ChArUco boards aruco_4x4_50.",
    ),
]
PixelSigma = Annotated[
    float | None,
    typer.Option("--pixel-sigma", help="Noise of a pixel coordinate [px].", callback=_positive),
]

# A robot's chain.
Robot = Annotated[str | None, typer.Option("--robot", help="A robot's name (nico) or a URDF file.")]
RobotSigma = Annotated[
    str | None,
    typer.Option(
        "--robot-sigma",
        metavar="DEG,MM",
        help="What each part of a described joint frame's turn and place is off by (standard "
        "deviations); the data tell it if omitted.",
    ),
]
Arm = Annotated[
    str | None, typer.Option("--arm", help="A named arm of the robot: right_arm, left_arm, neck.")
]
Arms = Annotated[
    str | None,
    typer.Option("--arms", help="Whole arms that move with the head: right, left or both."),
]
Base = Annotated[str | None, typer.Option("--base", help="Link where the chain starts.")]
Tip = Annotated[str | None, typer.Option("--tip", help="Link where the chain ends.")]
Hold = Annotated[
    list[str] | None,
    typer.Option("--hold", metavar="JOINT[=VALUE]", help="A joint of the chain that stands still."),
]
Point = Annotated[
    list[str] | None,
    typer.Option("--point", metavar="MARKER=LINK", help="Link or frame that a marker sits on."),
]

# A simulated robot.
Imperfections = Annotated[
    str,
    typer.Option(
        "--imperfections", help="Imperfections of body, trackers and pictures: thesis or clean."
    ),
]
RobotSeed = Annotated[
    int, typer.Option("--seed", min=0, help="Random seed: which simulated robot.")
]
FirstSeed = Annotated[
    int, typer.Option("--seed", min=0, help="Random seed: which simulated robot is the first.")
]
Session = Annotated[
    int, typer.Option("--session", min=0, help="Which recording of that robot: poses, noise.")
]
JointNoise = Annotated[
    float | None,
    typer.Option(
        "--joint-noise-deg", min=0.0, max=90.0, help="Half the width of the joints' noise [deg]."
    ),
]
RandomPoses = Annotated[
    int, typer.Option("--random", min=0, help="How many random poses to visit.")
]
Rendered = Annotated[
    bool, typer.Option("--rendered", help="Through rendered pictures; minutes a robot.")
]
_ROBOTS = "Simulated robots to average over"
Robots = Annotated[int, typer.Option("--robots", min=1, help=f"{_ROBOTS}.")]
RobotsOrOne = Annotated[
    int | None, typer.Option("--robots", min=1, help=f"{_ROBOTS}; 1 if --rendered.")
]
MIRROR = "ID[=MM,DEG,DEG]"
"""How a mirror is put before a simulated robot."""

# Real servos.
_PORT = typer.Option(
    "--port", help="Serial port: /dev/serial/by-id/..., or that of `servo simulate`."
)
_CONFIG = typer.Option("--config", help="Servo configuration (nico-servos/1).")
Port = Annotated[str, _PORT]
PortOrNone = Annotated[str | None, _PORT]
Config = Annotated[Path, _CONFIG]
ConfigOrNone = Annotated[Path | None, _CONFIG]
BaudOrNone = Annotated[
    int | None,
    typer.Option("--baud", help="Baud rate; that of the configuration, or the usual, if omitted."),
]
Make = Annotated[
    str, typer.Option("--make", help="Make of the motors: pic-servo, dynamixel or feetech.")
]
Speed = Annotated[
    float | None,
    typer.Option("--speed-deg-s", help="Largest speed of a joint; its limit if omitted."),
]
TrustZero = Annotated[
    bool, typer.Option("--trust-zero", help="Take the zero as it is though it was not homed.")
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask.")]
Seconds = Annotated[
    float | None, typer.Option("--seconds", min=0.0, help="End after this time [s].")
]
