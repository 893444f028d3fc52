"""`nico-selfmodel calibrate stereo` and `calibrate camera`: learn the eyes from a chessboard."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.given_names import ModelName, name_after

if TYPE_CHECKING:
    from nico_selfmodel.estimation import CameraOptions
    from nico_selfmodel.vision import BoardDetections

Images = Annotated[Path, typer.Argument(help="Folder of photographs of a chessboard.")]
Out = Annotated[Path, typer.Option("--out", help="Result folder to make.")]
BoardSize = Annotated[
    str, typer.Option("--board", metavar="COLSxROWS", help="Inner corners of the board, as 9x6.")
]
SquareMm = Annotated[float, typer.Option("--square-mm", help="Side of a square.")]
Window = Annotated[
    int, typer.Option("--window", min=2, help="Half side of the sub-pixel window [px].")
]
Pin = Annotated[
    list[str] | None,
    typer.Option("--pin", metavar="NAME[=VALUE]", help="Hold a parameter: left.k3=0, or k3=0."),
]
Free = Annotated[
    list[str] | None, typer.Option("--free", metavar="NAME", help="Let skew, p1 or p2 move.")
]
Prior = Annotated[
    list[str] | None,
    typer.Option("--prior", metavar="NAME=MEAN,SIGMA", help="What is known beforehand."),
]
Tangential = Annotated[
    bool, typer.Option("--tangential", help="Estimate tangential distortion p1, p2.")
]
FixedAspect = Annotated[bool, typer.Option("--fixed-aspect", help="Hold fx and fy equal.")]
LossName = Annotated[str, typer.Option("--loss", help="trimmed, none, huber, cauchy or tukey.")]
TestFraction = Annotated[
    float | None,
    typer.Option("--test-fraction", min=0.0, max=1.0, help="Share of the boards to hold out."),
]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Of the boards held out.")]
RequireTestPx = Annotated[
    float | None, typer.Option("--require-test-px", help="FAIL above this rms on held-out boards.")
]
SwapEyes = Annotated[
    bool, typer.Option("--swap-eyes", help="Take left* for the right eye, and right* for the left.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace an existing folder.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print result.json instead.")]


@dataclass(frozen=True)
class _Request:
    """What both commands ask for, once the boards are found."""

    options: "CameraOptions"
    test_fraction: float | None
    seed: int
    name: str
    require_test_px: float | None
    out: Path
    force: bool
    as_json: bool


def stereo(
    images: Images,
    board: BoardSize,
    square_mm: SquareMm,
    out: Out,
    window: Window = 11,
    pin: Pin = None,
    free: Free = None,
    prior: Prior = None,
    tangential: Tangential = False,
    fixed_aspect: FixedAspect = False,
    loss: LossName = "trimmed",
    test_fraction: TestFraction = None,
    seed: Seed = 0,
    name: ModelName = None,
    require_test_px: RequireTestPx = None,
    swap_eyes: SwapEyes = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Learn a pair of eyes from pairs of photographs, left* and right*, of a chessboard."""
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.vision import Board, detect_boards, stereo_pairs

    refuse_folder(out, force=force, inputs=[images])
    request = _Request(
        _options(pin, free, prior, tangential, fixed_aspect, loss),
        test_fraction,
        seed,
        name or name_after(images),
        require_test_px,
        out,
        force,
        as_json,
    )
    with console.progress_bar() as stage:
        pairs = stereo_pairs(images)
        if swap_eyes:
            pairs = [(name, right, left) for name, left, right in pairs]
        found = detect_boards(pairs, Board.parse(board, square_mm), window, stage)
        document = _learn(found, request, stage)
    _report(document, request)


def camera(
    images: Images,
    board: BoardSize,
    square_mm: SquareMm,
    out: Out,
    eye: Annotated[
        str, typer.Option("--eye", help="left or right: how the names of its images begin.")
    ] = "left",
    window: Window = 11,
    pin: Pin = None,
    free: Free = None,
    prior: Prior = None,
    tangential: Tangential = False,
    fixed_aspect: FixedAspect = False,
    loss: LossName = "trimmed",
    test_fraction: TestFraction = None,
    seed: Seed = 0,
    name: ModelName = None,
    require_test_px: RequireTestPx = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Learn one eye alone from photographs of a chessboard."""
    from nico_selfmodel.files import refuse_folder
    from nico_selfmodel.vision import Board, camera_images, detect_boards_of_one_eye

    if eye not in ("left", "right"):
        raise ValueError(f"--eye must be left or right, got {eye!r}")
    refuse_folder(out, force=force, inputs=[images])
    request = _Request(
        _options(pin, free, prior, tangential, fixed_aspect, loss),
        test_fraction,
        seed,
        name or name_after(images),
        require_test_px,
        out,
        force,
        as_json,
    )
    with console.progress_bar() as stage:
        listed = camera_images(images, eye)
        size = Board.parse(board, square_mm)
        found = detect_boards_of_one_eye(listed, size, window, stage, eye)
        document = _learn(found, request, stage)
    _report(document, request)


def _options(
    pin: list[str] | None,
    free: list[str] | None,
    prior: list[str] | None,
    tangential: bool,
    fixed_aspect: bool,
    loss: str,
) -> "CameraOptions":
    from nico_selfmodel.estimation import CameraOptions

    return CameraOptions.from_text(
        pin or (),
        free or (),
        prior or (),
        tangential=tangential,
        aspect=1.0 if fixed_aspect else None,
        loss=loss,
    )


def _learn(found: "BoardDetections", request: _Request, stage: console.Stage) -> dict[str, Any]:
    """Calibrate, judge and write the result folder; return its document."""
    from nico_selfmodel.estimation import CameraAssessment, calibrate_cameras, judge, to_json

    train, test = found.views, None
    if request.test_fraction is not None:
        train, test = found.seen_views.split(request.test_fraction, request.seed)
    stage("learning the eyes", 0, 2)
    calibration = calibrate_cameras(train, request.options)
    stage("learning the eyes", 1, 2)
    assessment = CameraAssessment.from_calibration(calibration, request.options, test)
    verdict = judge(assessment, require_test_px=request.require_test_px)
    document = to_json(assessment, verdict) | {"detection": found.document}
    stage("learning the eyes", 2, 2)
    stage("writing the result", 0, 1)
    # Drawing is slow to load, and only needed once there is something to draw.
    from nico_selfmodel.viz import write_camera_folder

    write_camera_folder(
        request.out,
        assessment,
        verdict,
        document,
        model=calibration.self_model(request.name, found.provenance),
        images=found.read_images(),
        force=request.force,
    )
    stage("writing the result", 1, 1)
    return document


def _report(document: dict[str, Any], request: _Request) -> None:
    if request.as_json:
        console.print_json(document)
    else:
        console.print_cameras(request.name, document, request.out)
    raise typer.Exit(1 if document["status"] == "FAIL" else 0)
