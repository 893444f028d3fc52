"""Bodies drawn at random with what their sensors would measure: truth for tests of one problem."""

from dataclasses import dataclass, replace

import numpy as np

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint, coupling_of, parents_of
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion

LENS = Camera(600.0, 600.0, 320.0, 240.0, (640, 480), k1=-0.1)


@dataclass(frozen=True, eq=False)
class Simulated:
    """A true body and what was recorded of it."""

    tree: BodyTree
    data: BodyDataset
    readings_true: np.ndarray
    """Displacements at which the body really stood. Shape (P, n)."""


def turned(rng, degrees, millimetres):
    """A small random motion."""
    w = rng.normal(size=3)
    w *= np.radians(degrees) / np.linalg.norm(w)
    t = rng.normal(size=3)
    return transform(rotation_from_vector(w), 1e-3 * millimetres * t / np.linalg.norm(t))


def serial(rng, names, first_parent, reach, base=None):
    """Joint frames of an arm whose axes alternate, lengths and twists drawn at random."""
    frames = []
    for i in range(len(names)):
        twist = rotation_from_vector([np.pi / 2 * (1 if i % 2 else -1) * (i > 0), 0.0, 0.0])
        tilt = rotation_from_vector(rng.normal(size=3) * 0.15)
        length = reach / len(names) * rng.uniform(0.6, 1.4)
        frames.append(transform(twist @ tilt, [0.2 * length, 0.1 * length, length]))
    if base is not None:
        frames[0] = base
    parents = [first_parent, *names[:-1]]
    return [LinkJoint(n, parent=p) for n, p in zip(names, parents, strict=True)], frames


def tags(rng, hand, link, count):
    """Tags about a hand."""
    markers = [MarkerInfo(f"{hand}_tag{k}", link) for k in range(count)]
    return markers, [
        Attached(m.name, 0, transform(np.eye(3), rng.normal(loc=[0, 0, 0.05], scale=0.05)))
        for m in markers
    ]


def observed(
    tree,
    joints,
    markers,
    sensors,
    q,
    rng,
    *,
    joint_sigma,
    sigma,
    seen=1.0,
    slip=None,
    distances=(),
    distance_sigma=1e-4,
):
    """Let sensors measure a body at readings q, each with its noise.

    Args:
        seen: Share of the tags that a sensor sees in a pose.
        slip: Joint, share of the poses, and size of its slips [rad].
        distances: Pairs of marker names measured once.
    """
    poses, n = q.shape
    off = joint_sigma * rng.normal(size=q.shape)
    if slip is not None:
        joint, share, size = slip
        off[:, joint] += size * rng.choice([-1.0, 1.0], poses) * (rng.random(poses) < share)
    flanges = np.full((poses, n, 6), np.nan)
    motion = TreeMotion.at(tree, q + off)
    table = {key: [] for key in ("pose", "sensor", "marker", "other", "values")}

    def add(pose, sensor, marker, values, other=-1):
        count = len(pose)
        table["pose"].append(pose)
        table["sensor"].append(np.full(count, sensor))
        table["marker"].append(np.full(count, marker))
        table["other"].append(np.full(count, other))
        padded = np.full((count, 6), np.nan)
        padded[:, : values.shape[1]] = values
        table["values"].append(padded)

    by_name = {s.name: s for s in tree.sensors}
    for s, info in enumerate(sensors):
        if info.kind == "distance":
            for a, b in distances:
                ia, ib = tree.marker_index(a), tree.marker_index(b)
                d = np.linalg.norm(tree.markers[ia].X_LA[:3, 3] - tree.markers[ib].X_LA[:3, 3])
                value = np.array([[d + distance_sigma * rng.normal()]])
                add(np.array([ANY_POSE]), s, ia, value, ib)
            continue
        R_WS, p_WS = motion.pose_of(by_name[info.name])
        for m, marker in enumerate(tree.markers):
            R_WM, p_WM = motion.pose_of(marker)
            p = np.einsum("jin,jn->in", R_WS, p_WM - p_WS).T
            who = np.arange(poses)
            if info.kind == "camera":
                lens = tree.lenses[info.name].at(np.eye(4))
                values = lens.project(p) + sigma[info.kind] * rng.normal(size=(poses, 2))
                inside = np.isfinite(values).all(axis=1)
                inside &= ((values > 0) & (values < np.array(lens.image_size))).all(axis=1)
                who = np.flatnonzero(inside)
            elif info.kind == "points":
                values = p + sigma[info.kind] * rng.normal(size=p.shape)
            else:
                R = np.einsum("jin,jkn->nik", R_WS, R_WM)
                turn = rotation_from_vector(sigma["turn"] * rng.normal(size=p.shape))
                values = np.hstack(
                    [p + sigma["points"] * rng.normal(size=p.shape), rotation_vectors_of(turn @ R)]
                )
            who = who[rng.random(len(who)) < seen]
            add(who, s, m, values[who])
    observations = ObservationTable(*(np.concatenate(table[key]) for key in table))
    return BodyDataset(
        "simulated",
        tuple(joints),
        tuple(markers),
        tuple(sensors),
        np.arange(poses),
        q,
        observations,
        flanges,
    )


def assembled(joints, frames, markers, attached, sensors, poses_of_sensors, lenses):
    """Put a body together."""
    parent, names = parents_of(tuple(joints)), [j.name for j in joints]

    def link(on):
        return -1 if on == "world" else names.index(on)

    return BodyTree(
        tuple(names),
        tuple(j.motion for j in joints),
        parent,
        np.stack(frames),
        np.ones(len(joints)),
        coupling_of(tuple(joints)),
        tuple(replace(a, on=link(m.on)) for a, m in zip(attached, markers, strict=True)),
        tuple(
            Attached(s.name, link(s.on), X)
            for s, X in zip(sensors, poses_of_sensors, strict=True)
            if s.kind != "distance"
        ),
        lenses,
    )


def looking_at(eye, target):
    """Pose of a camera at a place that looks at another."""
    z = np.asarray(target, dtype=float) - eye
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 0.0, -1.0], z)
    x /= np.linalg.norm(x)
    return transform(np.column_stack([x, np.cross(z, x), z]), eye)


def one_arm(seed, joints=5, markers=1, poses=60, sensor="points", sigma=None, shifts=None, **how):
    """An arm before a tracker, or before two cameras; some of its joints may shift."""
    rng = np.random.default_rng(seed)
    names = [f"j{i + 1}" for i in range(joints)]
    chain, frames = serial(rng, names, "world", 0.5)
    shifting = np.zeros(joints, dtype=bool) if shifts is None else shifts
    for i in np.flatnonzero(shifting):
        chain[i] = replace(chain[i], motion="prismatic", encoder_unit="m")
    infos, attached = tags(rng, "hand", names[-1], markers)
    if sensor == "points":
        sensors, places, lenses = [SensorInfo("tracker", "points")], [np.eye(4)], {}
    else:
        lens = dict(LENS.named_values)
        sensors = [
            SensorInfo(n, "camera", image_size=LENS.image_size, lens=lens)
            for n in ("left", "right")
        ]
        places = [looking_at(np.array([1.3, y, 0.4]), [0.0, 0.0, 0.3]) for y in (-0.25, 0.25)]
        lenses = dict.fromkeys(("left", "right"), LENS)
    sigma = sigma or {"points": 2e-4, "camera": 0.3, "turn": 2e-3}
    tree = assembled(chain, frames, infos, attached, sensors, places, lenses)
    q = rng.uniform(-1.2, 1.2, size=(poses, joints)) * np.where(shifting, 0.2, 1.0)
    how.setdefault("joint_sigma", np.where(shifting, 2e-4, np.radians(0.2)))
    data = observed(tree, chain, infos, sensors, q, rng, sigma=sigma, **how)
    return Simulated(tree, data, q)


def two_arms(seed, poses=60, torso=1, tags_each=7, camera=LENS, **how):
    """A torso with two arms of six joints before two cameras with known lenses."""
    rng = np.random.default_rng(seed)
    names = [f"torso{i + 1}" for i in range(torso)]
    joints, frames = serial(rng, names, "world", 0.3) if torso else ([], [])
    infos, attached = [], []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        own = [f"{side}{i + 1}" for i in range(6)]
        tilt = rotation_from_vector([sign * -np.pi / 2 + 0.2 * rng.normal(), 0.2 * rng.normal(), 0])
        base = transform(tilt, [0.0, sign * 0.15, 0.25])
        chain, X = serial(rng, own, names[-1] if torso else "world", 0.55, base)
        joints += chain
        frames += X
        found, where = tags(rng, side, own[-1], tags_each)
        infos += found
        attached += where
    lens = dict(camera.named_values)
    cameras = [("camera1", 0.4), ("camera2", -0.3)]
    sensors = [
        SensorInfo(n, "camera", image_size=camera.image_size, lens=lens, lens_kind=camera.lens)
        for n, _ in cameras
    ]
    places = [looking_at(np.array([1.5, y, 0.6]), [0.1, 0.0, 0.3]) for _, y in cameras]
    places += [np.eye(4)] * bool(how.get("distances"))
    how.setdefault("sigma", {"camera": 0.3})
    how.setdefault("joint_sigma", np.radians(0.05))
    how.setdefault("seen", 6 / 7)
    if how.get("distances"):
        sensors.append(SensorInfo("ruler", "distance", sigma=1e-4))
    tree = assembled(
        joints, frames, infos, attached, sensors, places, {n: camera for n, _ in cameras}
    )
    q = rng.uniform(-1.0, 1.0, size=(poses, len(joints)))
    q[:, :torso] *= 0.4
    data = observed(tree, joints, infos, sensors, q, rng, **how)
    return Simulated(tree, data, q)
