"""One small, sound input of every kind that a command reads, and the commands that read it."""

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.motion.motion_folder import save_motion
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.shape.shape_folder import save_shape

from ..drawn_boards import draw_pairs
from ..learned_ball import ball_body
from ..simulated_steps import SERVOS as STEPPING
from ..simulated_steps import steps_recorded

JOINTS = ("shoulder", "elbow", "wrist")
POSES = 40
HAND = np.array([0.03, 0.12, 0.15])
URDF = """\
<?xml version="1.0"?>
<robot name="small">
  <link name="base"><inertial><mass value="1.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <link name="upper"/><link name="fore"/><link name="palm"/>
  <joint name="shoulder" type="revolute"><origin xyz="0 0 0.1" rpy="0 0 0"/>
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="9" velocity="3"/></joint>
  <joint name="elbow" type="revolute"><origin xyz="0.05 0 0.2" rpy="0 0 0"/>
    <parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="9" velocity="3"/></joint>
  <joint name="wrist" type="revolute"><origin xyz="0.2 0.02 0" rpy="0 0 0"/>
    <parent link="fore"/><child link="palm"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="9" velocity="3"/></joint>
</robot>
"""
SERVOS = """\
format: nico-servos/1
name: arm
baud: 115200
latency_ms: 2
joints:
""" + "".join(
    f"""\
  - name: {name}
    address: {k}
    counts_per_turn: 200000
    output: three_phase
    lower_deg: -90
    upper_deg: 90
    max_velocity_deg_s: 60
    max_acceleration_deg_s2: 240
    gains: {{kp: 7, kd: 10}}
    home: {{method: limit_1, at_deg: 90, speed_deg_s: 5, travel_deg: 200}}
"""
    for k, name in enumerate(JOINTS, 1)
)
LEROBOT = json.dumps(
    {
        name: {"id": k, "drive_mode": 0, "homing_offset": -9, "range_min": 800, "range_max": 3000}
        for k, name in enumerate(JOINTS, 1)
    },
    indent=1,
)
MAP = """\
name: small
joints:
  - {name: shoulder, column: q1, encoder_unit: rad, lower: -2, upper: 2}
  - {name: elbow, column: q2, encoder_unit: deg}
  - {name: wrist, column: 4, encoder_unit: counts, counts_per_turn: 4096}
point: {x: x, y: y, z: z, unit: mm}
sample: pose
sweep: circle
not_measured: [NaN, -9999]
point_sigma_m: 0.0005
"""
BOARD = ("--board", "7x5", "--square-mm", "30", "--window", "5")


@dataclass(frozen=True)
class Reader:
    """A command that reads an input."""

    words: tuple[str, ...]
    """`{it}` is the folder of the spoilt input, `{sound}` that of all sound ones, `{out}` a folder
    to write into."""
    stdin_from: str | None = None
    """File of the input that is piped in."""


@dataclass(frozen=True)
class Kind:
    """A kind of input."""

    name: str
    folder: str
    """Among the sound inputs; the whole of it is copied for each mutation."""
    file: str
    """The file in it that is spoilt."""
    readers: tuple[Reader, ...]


def _readers(*lines: str) -> tuple[Reader, ...]:
    return tuple(Reader(tuple(line.split())) for line in lines)


ARM = "{sound}/arm/self_model.yaml"
BODY = "{sound}/body/self_model.yaml"
ROBOT = "--robot {sound}/robot/small.urdf --base base --tip palm"
_DATA = _readers(
    "calibrate kinematics {it} --test-fraction 0.3 --starts 3 --out {out}/a --json",
    "calibrate kinematics {sound}/train --test {it} --out {out}/b",
    "calibrate kinematics {it} " + ROBOT + " --out {out}/c",
    "evaluate " + ARM + " {it} --json",
    "monitor " + ARM + " {it} --relearn --out {out}/d --json",
    "rezero " + ARM + " {it} --out {out}/e --json",
    "choose-poses " + ARM + " {it} --count 3 --out {out}/f.csv --json",
    "calibrate tool {it} --model " + ARM + " --tool hand --out {out}/g --json",
)
_SEEN = _readers(
    "calibrate mirror {it} --model " + BODY + " --test-fraction 0.3 --out {out}/a --json",
    "calibrate body {it} --model " + BODY + " --stage kinematics --out {out}/b --json",
    "calibrate kinematics {it} --cameras " + BODY + " --starts 2 --out {out}/c --json",
    "evaluate " + BODY + " {it}",
    "monitor " + BODY + " {it} --json",
    "calibrate tool {it} --model " + BODY + " --tool hand --out {out}/d --json",
    "rezero " + BODY + " {it} --out {out}/e --json",
)
_ARM = _readers(
    "predict {it} --encoders 0.1,0.2,0.3 --encoders 9,9,9 --json",
    "predict {it} --table {sound}/poses/poses.csv",
    "evaluate {it} {sound}/data --json",
    "monitor {it} {sound}/data --json",
    "rezero {it} {sound}/data --out {out}/a --json",
    "choose-poses {it} {sound}/data --count 3 --out {out}/b.csv --json",
    "calibrate tool {sound}/data --model {it} --tool hand --out {out}/c --json",
    "export-urdf {it} --out {out}/d.urdf",
    "servo status --port {port} --config {sound}/servos/servos.yaml --trust-zero --model {it}",
)
_BODY = _readers(
    "predict {it} --encoders 1000,2000,300,400 --json",
    "locate {it} --mirror middle --pixels {pixels} --json",
    "evaluate {it} {sound}/seen",
    "monitor {it} {sound}/seen --json",
    "calibrate mirror {sound}/seen --model {it} --out {out}/a --json",
    "calibrate body {sound}/seen --model {it} --stage kinematics --out {out}/b --json",
    "calibrate kinematics {sound}/seen --cameras {it} --starts 2 --out {out}/c --json",
    "export-urdf {it} --out {out}/d.urdf",
)
_SERVOS = _readers(
    "servo simulate --config {it}/servos.yaml --seconds 0.05",
    "servo status --port {port} --config {it}/servos.yaml --trust-zero --json",
    "servo move elbow 10 --port /dev/null --config {it}/servos.yaml",
    "servo home --port /dev/null --config {it}/servos.yaml --yes",
    "record --out {out}/r --port /dev/null --config {it}/servos.yaml --yes"
    " --motion-capture 127.0.0.1:9",
)
_PICTURE = (
    "detect {it}/%s --fiducial --out {out}/a --json",
    "detect {it}/%s --color {sound}/color/red.yaml --out {out}/b",
    "detect {it}/%s --board 5x4 --out {out}/c --json",
    "pick-color {it}/%s --at 20,20 --mask {out}/mask.png --out {out}/d.yaml",
)
_BOARDS = _readers(
    "calibrate stereo {it} " + " ".join(BOARD) + " --out {out}/a --json",
    "calibrate camera {it} " + " ".join(BOARD) + " --out {out}/b",
    "detect {it} --board 7x5 --window 5 --out {out}/c --json",
)
_ROBOT = _readers(
    "calibrate kinematics {sound}/data --robot {it}/small.urdf --base base --tip palm"
    " --out {out}/a --json",
    "calibrate kinematics {sound}/data --robot {it}/small.urdf --out {out}/b",
    "export-urdf {sound}/with_robot/self_model.yaml --out {out}/c.urdf",
)
_TABLE = _readers("import csv {it}/table.csv --map {it}/map.yaml --out {out}/a")
_VICON = _readers(
    "import vicon {it}/trial.csv --encoders {it}/readings.csv --encoder-unit rad --out {out}/a",
)
_POSES = (
    *_readers(
        "predict " + ARM + " --table {it}/poses.csv --json",
        "predict " + ARM + " --table {it}/poses.csv",
    ),
    Reader(("predict", ARM, "--table", "-", "--json"), stdin_from="poses.csv"),
)
_RECORDED = _readers("record --out {it} --sensor motion-capture --circle 0 --random 3")
_TO_VISIT = _readers(
    "record --out {out}/r --sensor motion-capture --circle 0 --poses {it}/poses.csv",
)
_STEPS = _readers("calibrate servos {it} --no-report --out {out}/a")
_SHAPE = _readers("export-urdf {it} --out {out}/d.urdf", "view {it} --out {out}/scene.html")
_RESULT = _readers("view {it} --out {out}/scene.html")
WORDS = _readers(
    "calibrate kinematics {sound}/data --name {odd} --out {out}/a",
    "calibrate kinematics {sound}/data --fix {odd} --out {out}/a",
    "calibrate kinematics {sound}/data --fix elbow.r={odd} --out {out}/a",
    "calibrate kinematics {sound}/data --free {odd} --out {out}/a",
    "calibrate kinematics {sound}/data --test-fraction {odd} --out {out}/a",
    "calibrate kinematics {sound}/data --require-test-mm {odd} --test-fraction 0.3 --out {out}/a",
    "calibrate kinematics {sound}/data --robot {odd} --out {out}/a",
    "calibrate kinematics {sound}/data " + ROBOT + " --hold {odd} --out {out}/a",
    "calibrate kinematics {sound}/data " + ROBOT + " --point {odd} --out {out}/a",
    "calibrate kinematics {odd} --out {out}/a",
    "evaluate {odd} {sound}/data",
    "predict " + ARM + " --encoders {odd}",
    "predict " + ARM + " --encoders 0.1,{odd},0.3 --json",
    "predict " + ARM + " --encoders 0,0,0 --marker {odd}",
    "locate " + BODY + " --mirror {odd} --pixels {pixels}",
    "locate " + BODY + " --mirror middle --pixels 250,{odd},230,250 --json",
    "locate " + BODY + " --mirror middle --pixels {pixels} --pixel-sigma {odd} --json",
    "export-urdf " + ARM + " --out {out}/{odd}",
    "calibrate camera {sound}/boards --board {odd} --square-mm 30 --out {out}/a",
    "calibrate camera {sound}/boards --board 7x5 --square-mm {odd} --out {out}/a",
    "calibrate stereo {sound}/boards " + " ".join(BOARD) + " --prior left.cx={odd} --out {out}/a",
    "calibrate mirror {sound}/seen --model " + BODY + " --joint-sigma-deg {odd} --out {out}/a",
    "pick-color {sound}/picture/a.png --at {odd} --out {out}/a.yaml",
    "pick-color {sound}/picture/a.png --at 20,20 --radius {odd} --out {out}/a.yaml",
    "detect {sound}/picture/a.png --fiducial --family {odd} --out {out}/a",
    "import csv {sound}/table/table.csv --map {sound}/table/map.yaml --name {odd} --out {out}/a",
    "import vicon {sound}/vicon/trial.csv --encoders {sound}/vicon/readings.csv --encoder-unit"
    " counts --counts-per-turn {odd} --out {out}/a",
    "import vicon {sound}/vicon/trial.csv --encoders {sound}/vicon/readings.csv --encoder-unit"
    " rad --marker {odd} --out {out}/a",
    "record --out {out}/r --sensor motion-capture --circle 0 --random 2 --imperfections {odd}",
    "markers sheet --out {out}/a.svg --ids {odd}",
    "markers sheet --out {out}/a.svg --size-mm {odd}",
    "servo move elbow {odd} --port {port} --config {sound}/servos/servos.yaml",
    "servo move {odd} 10 --port {port} --config {sound}/servos/servos.yaml",
    "rezero " + ARM + " {sound}/data --joint {odd} --out {out}/a",
    "calibrate tool {sound}/data --model " + ARM + " --tool {odd} --out {out}/a",
    "monitor " + ARM + " {sound}/data --sensor {odd}",
)
"""Commands with an odd word."""
KINDS = (
    Kind("data set, head", "data", "dataset.yaml", _DATA),
    Kind("data set, rows", "data", "samples.csv", _DATA),
    Kind("seen data set, head", "seen", "dataset.yaml", _SEEN),
    Kind("seen data set, rows", "seen", "samples.csv", _SEEN),
    Kind("self-model of an arm", "arm", "self_model.yaml", _ARM),
    Kind("self-model of a body", "body", "self_model.yaml", _BODY),
    Kind("servos", "servos", "servos.yaml", _SERVOS),
    Kind("lerobot calibration", "lerobot", "arm.json", _readers(
        "import lerobot {it}/arm.json --make dynamixel --out {out}/a.yaml",
    )),
    Kind("table", "table", "table.csv", _TABLE),
    Kind("column map", "table", "map.yaml", _TABLE),
    Kind("motion capture export", "vicon", "trial.csv", _VICON),
    Kind("readings", "vicon", "readings.csv", _VICON),
    Kind("colour", "color", "red.yaml", _readers(
        "detect {sound}/picture/a.png --color {it}/red.yaml --out {out}/a --json",
    )),
    Kind("PNG", "picture", "a.png", _readers(*(line % "a.png" for line in _PICTURE))),
    Kind("JPEG", "picture", "a.jpg", _readers(*(line % "a.jpg" for line in _PICTURE))),
    Kind("boards", "boards", "left2.png", _BOARDS),
    Kind("robot", "robot", "small.urdf", _ROBOT),
    Kind("poses", "poses", "poses.csv", _POSES),
    Kind("poses to visit", "to_visit", "poses.csv", _TO_VISIT),
    Kind("recording, rows", "recorded", "samples.csv", _RECORDED),
    Kind("recording, head", "recorded", "dataset.yaml", _RECORDED),
    Kind("scene", "result", "scene.json", _RESULT),
    Kind("steps, rows", "steps", "motion.csv", _STEPS),
    Kind("steps, head", "steps", "dataset.yaml", _STEPS),
    Kind("learned shape", "shape", "body/shape.yaml", _SHAPE),
    Kind("mesh of a learned shape", "shape", "body/palm.ply", _SHAPE),
)  # fmt: skip


def make_sound_inputs(sound: Path, command) -> dict[str, str]:
    """Write one input of every kind; return what readers fill in besides the folders.

    Args:
        sound: Where to.
        command: Runs `nico-selfmodel`; it makes what only commands make.
    """
    q, data = _small_data(5)
    save_dataset(data, sound / "data")
    save_dataset(_small_data(6)[1], sound / "train")
    for folder, name, text in (
        ("robot", "small.urdf", URDF),
        ("servos", "servos.yaml", SERVOS),
        ("lerobot", "arm.json", LEROBOT),
        ("table", "map.yaml", MAP),
        ("table", "table.csv", _table(data)),
        ("vicon", "trial.csv", _vicon(data)),
        ("vicon", "readings.csv", _readings(q)),
        ("poses", "poses.csv", "shoulder,elbow,wrist\n0.1,0.2,0.3\n-0.5,0.4,1e-1\n"),
    ):
        (sound / folder).mkdir(exist_ok=True)
        (sound / folder / name).write_text(text)
    robot = ROBOT.format(sound=sound).split()
    learn = ("calibrate", "kinematics", sound / "train", "--test-fraction", "0.3", "--out")
    _done(command(*learn, sound / "result"))
    _done(command(*learn, sound / "with_robot", *robot))
    (sound / "arm").mkdir()
    model = (sound / "result" / "self_model.yaml").read_bytes()
    (sound / "arm" / "self_model.yaml").write_bytes(model)
    shutil.copytree(sound / "with_robot", sound / "shape")
    save_shape(ball_body("palm", "fore"), sound / "shape" / "body")
    _make_recording(sound, command)
    save_motion(steps_recorded(STEPPING[:1], count=4, period=0.1), sound / "steps")
    _make_pictures(sound)
    return _make_seen(sound, command)


def _done(done) -> None:
    assert done.returncode in (0, 1), (done.args, done.stdout, done.stderr)


def _small_data(seed: int) -> tuple[np.ndarray, Dataset]:
    rng = np.random.default_rng(seed)
    circle = np.linspace(-1.0, 1.0, 6)
    q = np.vstack(
        [np.zeros((1, 3)), *(circle[:, None] * np.eye(3)[i] for i in range(3)),
         rng.uniform(-1.5, 1.5, (POSES - 19, 3))]
    )  # fmt: skip
    sweep = ["home", *np.repeat(JOINTS, 6).tolist(), *[""] * (POSES - 19)]
    p = _hand(q) + rng.normal(0.0, 3e-4, (POSES, 3))
    return q, Dataset(
        name=f"small {seed}",
        joints=tuple(JointInfo(name, "rad", lower=-2.0, upper=2.0) for name in JOINTS),
        source="drawn",
        sample=np.arange(1, POSES + 1),
        encoders=q,
        p_WH_measured=p,
        sweep=np.array(sweep),
        marker=np.full(POSES, "hand"),
        mirror=np.full(POSES, ""),
        pixels=np.full((POSES, 4), np.nan),
        point_sigma_m=5e-4,
    )


def _hand(q: np.ndarray) -> np.ndarray:
    """Return where the hand of `URDF` is [m]. Shape (n, 3)."""
    p = np.tile(HAND, (len(q), 1))
    for angle, axis, origin in zip(
        q.T[::-1], (0, 1, 2), ((0.2, 0.02, 0), (0.05, 0, 0.2), (0, 0, 0.1)), strict=True
    ):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        turned = p.copy()
        turned[:, b] = np.cos(angle) * p[:, b] - np.sin(angle) * p[:, c]
        turned[:, c] = np.sin(angle) * p[:, b] + np.cos(angle) * p[:, c]
        p = turned + origin
    return p


def _table(data: Dataset) -> str:
    rows = ["pose,q1,q2,q3,x,y,z,circle"]
    for k, (q, p, sweep) in enumerate(
        zip(data.encoders, data.p_WH_measured, data.sweep, strict=True), 1
    ):
        cells = [q[0], np.degrees(q[1]), round(q[2] * 4096 / (2 * np.pi)), *(1e3 * p)]
        rows.append(f"{k}," + ",".join(f"{cell:.5g}" for cell in cells) + f",{sweep}")
    return "\n".join(rows) + "\n"


def _vicon(data: Dataset) -> str:
    rows = ["Trajectories", "100", ",,Nico:hand,,", "Frame,Sub Frame,X,Y,Z", ",,mm,mm,mm"]
    for frame, p in enumerate(1e3 * data.p_WH_measured, 1):
        rows.append(f"{frame},0," + ",".join(f"{x:.4f}" for x in p))
    return "\n".join(rows) + "\n"


def _readings(q: np.ndarray) -> str:
    rows = ["frame,shoulder,elbow,wrist"]
    rows += [f"{k}," + ",".join(f"{x:.6f}" for x in row) for k, row in enumerate(q, 1)]
    return "\n".join(rows) + "\n"


def _make_recording(sound: Path, command) -> None:
    """Write a recording that was interrupted, and poses for another one."""
    recorded = sound / "recorded"
    words = ("--sensor", "motion-capture", "--circle", "0", "--random", "3")
    _done(command("record", "--out", recorded, *words))
    lines = (recorded / "samples.csv").read_text().splitlines(keepends=True)
    (recorded / "samples.csv").write_text("".join(lines[:-1]))
    (sound / "to_visit").mkdir()
    joints = [joint.name for joint in load_dataset(recorded).joints]
    rows = [",".join(joints), *(",".join(["100"] * len(joints)) for _ in range(2))]
    (sound / "to_visit" / "poses.csv").write_text("\n".join(rows) + "\n")


def _make_pictures(sound: Path) -> None:
    for folder in ("picture", "boards", "color"):
        (sound / folder).mkdir()
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    picture = np.full((120, 160, 3), 200, np.uint8)
    picture[40:88, 90:138] = cv2.aruco.generateImageMarker(markers, 3, 48)[:, :, None]
    cv2.circle(picture, (30, 30), 18, (45, 40, 190), -1, cv2.LINE_AA)
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7)
    cv2.imwrite(str(sound / "picture" / "a.png"), picture)
    cv2.imwrite(str(sound / "picture" / "a.jpg"), picture)
    draw_pairs(sound / "boards", count=4)
    for path in (sound / "boards").iterdir():
        path.rename(path.with_name(path.name.replace("0", "")))


def _together(one: Dataset, other: Dataset) -> Dataset:
    columns = ("encoders", "p_WH_measured", "pixels", "sweep", "marker", "mirror")
    rows = {c: np.concatenate([getattr(one, c), getattr(other, c)]) for c in columns}
    return replace(one, sample=np.arange(1, len(one) + len(other) + 1), extra={}, **rows)


def _make_seen(sound: Path, command) -> dict[str, str]:
    """Write a body with cameras that met a mirror, and what it saw."""
    body = mirror_body(2)
    save_model(body.calibrated(), sound / "cameras.yaml")
    save_dataset(
        _together(body.watch("", 12, session=1), body.watch("middle", 8, session=2)), sound / "seen"
    )
    words = ("--model", sound / "cameras.yaml", "--stage", "kinematics")
    _done(command("calibrate", "body", sound / "seen", *words, "--out", sound / "nico"))
    words = ("--model", sound / "nico", "--test-fraction", "0.3")
    _done(command("calibrate", "mirror", sound / "seen", *words, "--out", sound / "body"))
    for path in (sound / "body").iterdir():
        if path.name != "self_model.yaml":
            path.unlink()
    pixels = body.watch("middle", 1, session=5).pixels[0]
    _done(
        command(
            *("pick-color", sound / "picture" / "a.png", "--at", "30,30"),
            *("--out", sound / "color" / "red.yaml"),
        )
    )
    return {"pixels": ",".join(f"{x:.3f}" for x in pixels)}
