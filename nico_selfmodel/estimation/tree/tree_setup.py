"""What a recording leaves to be estimated: frames that stay, what is free, what holds the scale."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import coupling_of, parents_of
from nico_selfmodel.dataset.body.sensors import (
    CAMERA,
    CONTACT,
    DISTANCE,
    PLANE,
    POINTS,
    POSES,
    SIGHTS,
    SensorInfo,
)
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.contradictions.refused_wishes import (
    refuse_frames,
    refuse_free_world,
    refuse_planes,
    refuse_untold,
)
from nico_selfmodel.estimation.tree.guesses.told_frames import (
    exchanged_parts,
    told_on_links,
    told_size,
)
from nico_selfmodel.estimation.tree.tree_parameters import (
    APART,
    FRAME_PARTS,
    PLANE_PARTS,
    SHIFTS,
    TURNS,
    TreeParameters,
)
from nico_selfmodel.files.csv_rows import number_of_word
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.tree.body_tree import (
    FLANGE,
    FREE,
    PRISMATIC,
    WHOLE_POSES,
    WORLD,
    WORLD_NAME,
    Attached,
    BodyTree,
)
from nico_selfmodel.names import listed, refuse_unknown

KNOWN_PLACES = "markers at known places"
"""What stands for the world, and tells lengths, where a recording says where markers are."""
DESCRIBED = "robot description"
"""What tells lengths where only that does."""
Priors = Mapping[str, tuple[float, float]]
"""Mean and standard deviation by name."""

_UNSURE = 1e-3
"""What recordings leave open of a length, about [m]: of two lengths told exactly the longer one
says better how large all is."""


@dataclass(frozen=True, eq=False)
class Description:
    """A robot as its description has it, and how far it may be off."""

    tree: BodyTree
    """The robot in its base link's frame; sensors and unknown markers anywhere."""
    turn_sigma: float = float(np.radians(2.0))
    """Standard deviation of each part of a joint frame's turn [rad]."""
    shift_sigma: float = 0.01
    """That of each part of its place [m]."""
    learned: bool = True
    """Whether the data tell both, the same for all frames, which are about these beforehand, within
    a factor of three; else they are these."""
    masses: tuple[NDArray, NDArray] | None = None
    """Mass of each link [kg], shape (n,), and its centre there [m], shape (n, 3), where known."""


@dataclass(frozen=True, eq=False)
class Wishes:
    """What the user holds, frees or knows by name."""

    pins: FixedParameters = field(default_factory=FixedParameters)
    """Fixed and freed parameters."""
    priors: Priors = field(default_factory=dict)
    """What is known of some."""
    by_poses: frozenset[str] = frozenset()
    """Names among both that the recording's known poses of sensors tell, not the user."""

    def __post_init__(self) -> None:
        """Refuse what is known for sure and not so surely."""
        both = sorted(self.pins.pinned.keys() & self.priors.keys())
        if both:
            raise ValueError(f"{listed(both)}: fixed and given a prior; leave out one of them")

    def freeing(self, names: Collection[str]) -> "Wishes":
        """Return the same with more that moves, but for what the user holds."""
        freed = self.pins.freed | (frozenset(names) - set(self.pins.pinned))
        return replace(self, pins=replace(self.pins, freed=freed))


def robot_sigmas_of(word: str) -> tuple[float, float]:
    """Read `--robot-sigma DEG,MM` of the command line.

    Returns:
        Standard deviations of each part of a described frame's turn [rad] and place [m].

    Raises:
        ValueError: If it is not two positive numbers.
    """
    degrees, comma, millimetres = word.partition(",")
    where = f"--robot-sigma {word}"
    if not comma:
        raise ValueError(f"{where} must be DEG,MM: as 2,10 for 2 deg and 10 mm")
    turn, shift = number_of_word(degrees, where), number_of_word(millimetres, where)
    if not (turn > 0.0 and shift > 0.0):
        raise ValueError(f"{where}: both must be positive")
    return float(np.radians(turn)), 1e-3 * shift


@dataclass(frozen=True)
class Alike:
    """Parameters that are off by the same standard deviation, which the data tell."""

    names: tuple[str, ...]
    """Which."""
    sigma: float
    """What it is about beforehand [rad or m]."""


@dataclass(frozen=True, eq=False)
class TreeSetup:
    """What is estimated."""

    free: frozenset[str]
    """Names of the parameters that move."""
    priors: Priors
    """What is known of them beforehand."""
    fixed: Mapping[str, float]
    """Values at which the user holds some."""
    world: str
    """What stands for the world: a sensor, a joint, a marker, or `base` of a described robot."""
    scale_from: str | None
    """What tells lengths; None where nothing does, and one is held."""
    told: Mapping[str, float] = field(default_factory=dict)
    """What is told of places on links that nothing describes: it says where their frames are."""
    alike: tuple[Alike, ...] = ()
    """Parameters whose priors have one standard deviation, which is learned: see `Description`."""


def blank_body(data: BodyDataset, lenses: Mapping[str, Camera]) -> BodyTree:
    """Return a body with the recording's joints, markers and sensors, all frames the identity.

    Args:
        lenses: Intrinsics of cameras, by name; the recording's own where they are not given, and
            any where neither is.
    """
    found: dict[str, Camera] = {}
    for info in data.sensors:
        if info.kind == CAMERA:
            lens = lenses.get(info.name, info.camera)
            if lens is None:
                width, height = info.image_size or (1, 1)
                lens = Camera(width, width, 0.5 * width, 0.5 * height, (width, height))
            found[info.name] = lens
    n = len(data.joints)
    identity = np.eye(4)
    return BodyTree(
        data.joint_names,
        tuple(joint.motion for joint in data.joints),
        parents_of(data.joints),
        np.broadcast_to(identity, (n, 4, 4)),
        np.ones(n),
        coupling_of(data.joints),
        tuple(
            Attached(
                m.name,
                data.on_link(m.on),
                transform(np.eye(3), np.array(m.xyz or (0.0, 0.0, 0.0))),
            )
            for m in data.markers
        ),
        tuple(
            Attached(s.name, data.on_link(s.on), identity if s.X_LS is None else s.X_LS)
            for s in data.sensors
            if s.kind in SIGHTS
        ),
        found,
        planes=tuple(
            Attached(s.name, data.on_link(s.on), identity if s.X_LS is None else s.X_LS)
            for s in data.sensors
            if s.kind == PLANE
        ),
        contacts={s.name: 0.0 for s in data.sensors if s.kind == CONTACT},
    )


def setup_of(
    data: BodyDataset,
    parameters: TreeParameters,
    description: Description | None,
    wishes: Wishes,
) -> TreeSetup:
    """Return what is estimated.

    Args:
        description: The robot as described, whose errors have priors.

    Raises:
        DataError: If nothing stands for the world.
        ValueError: If a name does not exist, or is held where nothing tells its value.
    """
    _check_names(parameters, wishes)
    held = wishes.pins.pinned.keys() | wishes.priors.keys()
    if description is None:
        refuse_frames(parameters.base, held)
    refuse_planes(data, held)
    world = world_of(data, description)
    free, priors = set[str](), dict[str, tuple[float, float]]()
    moving = moving_joints(data, parameters)
    for i, joint in enumerate(data.joints):
        if not moving[i] or joint.motion == FREE:
            continue
        names = [f"{joint.name}.{part}" for part in FRAME_PARTS]
        if joint.motion == FLANGE:
            free |= set() if joint.name == world else set(names)
        elif description is not None:
            free |= set(names)
            priors |= dict.fromkeys(names[:3], (0.0, description.turn_sigma))
            priors |= dict.fromkeys(names[3:], (0.0, description.shift_sigma))
        else:
            free |= parameters.line_of(joint.name)
        if not joint.gear_known and not joint.follows:
            free.add(f"{joint.name}.gear")
    free |= {name for mirror in data.mirrors for name in Mirror.names_of(mirror)}
    table = data.observations
    posed = np.array([s.kind == POSES for s in data.sensors])[table.sensor]
    for m in np.unique(np.append(table.marker, table.other[table.other >= 0])).tolist():
        turned = posed[table.marker == m].any()
        parts = (*(TURNS if turned else ()), *(() if data.markers[m].xyz else SHIFTS))
        if description is None and data.markers[m].name == world:
            continue
        free |= {f"{data.markers[m].name}.{part}" for part in parts}
    for s in np.unique(table.sensor).tolist():
        info = data.sensors[s]
        if info.name != world:
            free |= {f"{info.name}.{part}" for part in parts_of(info)}
    given = {n: v for n, v in wishes.pins.pinned.items() if v is not None}
    refuse_untold(data, free & (wishes.pins.pinned.keys() - given.keys()))
    told = {}
    if description is None:
        known = {name: mean for name, (mean, _) in wishes.priors.items()} | given
        told = told_on_links(data, parameters.base, known)
    free |= exchanged_parts(parameters.base, told)
    priors |= dict(wishes.priors)
    free = (free | wishes.pins.freed | set(wishes.priors)) - set(wishes.pins.pinned)
    scale = _scale_from(data, parameters.base, description, wishes, told)
    if scale is None:
        refuse_free_world(world, wishes.pins.freed)
        free -= {held_scale(parameters.base, world, free) or ""}
    alike = _alike(data, description, wishes)
    return TreeSetup(frozenset(free), priors, given, world, scale, told, alike)


def parts_of(sensor: SensorInfo) -> tuple[str, ...]:
    """Return the parts of a sensor that can be told, but for a lens."""
    parts: Mapping[str, tuple[str, ...]] = {DISTANCE: (), CONTACT: (APART,), PLANE: PLANE_PARTS}
    return parts.get(sensor.kind, FRAME_PARTS)


def _alike(data: BodyDataset, description: Description | None, wishes: Wishes) -> tuple[Alike, ...]:
    """Return which priors share a standard deviation that is learned: those that nobody stated."""
    if description is None or not description.learned:
        return ()
    frames = [joint.name for joint in data.joints if joint.motion not in WHOLE_POSES]
    turns, places = (
        tuple(n for f in frames for p in parts if (n := f"{f}.{p}") not in wishes.priors)
        for parts in (TURNS, SHIFTS)
    )
    return Alike(turns, description.turn_sigma), Alike(places, description.shift_sigma)


def _check_names(parameters: TreeParameters, wishes: Wishes) -> None:
    for name in sorted(wishes.pins.names | set(wishes.priors)):
        refuse_unknown("parameter", name, parameters.names)


def moving_joints(data: BodyDataset, parameters: TreeParameters) -> NDArray:
    """Return which joints move anything against what sees it. Boolean, shape (n,)."""
    table, beyond = data.observations, parameters.base.beyond
    on_marker = np.array([data.on_link(m.on) for m in data.markers])
    on_sensor = np.array([data.on_link(s.on) for s in data.sensors])
    seen = on_marker[table.marker]
    seeing = np.where(table.other >= 0, on_marker[table.other], on_sensor[table.sensor])
    # What carries marker and camera moves the one against the other's image in a mirror.
    both = (table.mirror != "")[:, None] & beyond[seen]
    return np.asarray(((beyond[seen] != beyond[seeing]) | both).any(axis=0))


def world_of(data: BodyDataset, description: Description | None) -> str:
    """Return what stands for the world: all else is placed against it."""
    known = [m.name for m in data.markers if m.xyz is not None and m.on == WORLD_NAME]
    if known and description is not None:
        raise DataError(
            f"the places of {listed(known)} are known in the room, those of the robot's "
            "description in its base: leave out --robot, or 'xyz' of the markers"
        )
    if known:
        return KNOWN_PLACES
    if description is not None:
        return "base"
    used = np.unique(data.observations.sensor).tolist()
    seeing = [data.sensors[s] for s in used if data.sensors[s].kind in SIGHTS]
    standing = [s for s in seeing if s.on == WORLD_NAME]
    trackers = [s.name for s in standing if s.kind in (POINTS, POSES)]
    flanges = [j.name for j in data.joints if j.motion == FLANGE and j.parent == WORLD_NAME]
    cameras = [s.name for s in standing if s.kind == CAMERA]
    for names in (trackers, flanges, cameras):
        if names:
            return names[0]
    if (tag := standing_tag(data)) is not None:
        return tag
    raise DataError(
        "nothing stands still in the world that could tell where the body is: no tracker, camera "
        "or flange is on 'world', nor a marker whose poses a sensor tells; give the robot's "
        "description"
    )


def standing_tag(data: BodyDataset) -> str | None:
    """Return the marker on the world whose poses sensors told most often; None where there is none.

    Of a body that carries its sensors it stands for the world where nothing else does.
    """
    table = data.observations
    posed = np.array([sensor.kind == POSES for sensor in data.sensors])[table.sensor]
    standing = np.array([marker.on == WORLD_NAME for marker in data.markers])[table.marker]
    counts = np.bincount(table.marker[posed & standing], minlength=1)
    return data.markers[int(counts.argmax())].name if counts.any() else None


def _scale_from(
    data: BodyDataset,
    tree: BodyTree,
    description: Description | None,
    wishes: Wishes,
    told: Mapping[str, float],
) -> str | None:
    """Return what tells lengths; None where everything could be larger."""
    if any(m.xyz is not None and f"{m.name}.x" not in told for m in data.markers):
        return KNOWN_PLACES
    used = set(data.observations.sensor.tolist())
    kinds = {data.sensors[s].kind: data.sensors[s].name for s in used}
    for kind in (POINTS, POSES):
        if kind in kinds:
            return kinds[kind]
    if any(joint.motion == FLANGE for joint in data.joints):
        return "flange"
    if DISTANCE in kinds:
        return f"{kinds[DISTANCE]} (known distances)"
    travelled = [j.name for j in data.joints if j.motion == PRISMATIC and j.gear_known]
    if travelled:
        return f"{travelled[0]} (travel)"
    if description is not None:
        return DESCRIBED
    known = {n: (v, 0.0) for n, v in wishes.pins.pinned.items() if v} | dict(wishes.priors)
    lengths = [n for n in known.keys() - told.keys() if n.rpartition(".")[2] in (*SHIFTS, APART)]
    # All others are known to as good a share as this one at best.
    certain = {n: abs(known[n][0]) / np.hypot(known[n][1], _UNSURE) for n in sorted(lengths)}
    return max(certain, key=certain.__getitem__, default=told_size(tree, told))


def held_scale(tree: BodyTree, world: str, free: Collection[str]) -> str | None:
    """Return the largest part of the first other camera's place, which holds the scale.

    Args:
        world: What stands for the world.
        free: Names of what moves: a camera that saw nothing does not.
    """
    moved = {name.rpartition(".")[0] for name in free}
    for sensor in tree.sensors:
        other = sensor.name != world and sensor.name in moved
        if other and sensor.name in tree.lenses and sensor.on == WORLD:
            largest = int(np.argmax(np.abs(sensor.X_LA[:3, 3])))
            return f"{sensor.name}.{SHIFTS[largest]}"
    return None
