"""Write what two cameras see of two arms as a recording, as any detector of tags would.

    python examples/15_two_arms_two_cameras.py two_arms
    nico-selfmodel calibrate body two_arms --test-fraction 0.25 --out body

Nothing but the lenses and three distances of tags is told: joints, tags and cameras are found.
"""

import csv
import sys
from pathlib import Path

import numpy as np

POSES, TAGS, FOCAL = 80, 5, 600.0
JOINTS = [("torso", "world"), *((f"{s}{i}", f"{s}{i - 1}" if i else "torso")
                                for s in ("left", "right") for i in range(6))]  # fmt: skip
CAMERAS = {"camera1": [1.5, 0.4, 0.6], "camera2": [1.5, -0.3, 0.6]}


def turn(axis, angle):
    """Rotate about x, y or z."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[i, j], R[j, i] = -np.sin(angle), np.sin(angle)
    return R


def body(rng):
    """Joint frames on their parents, and tags on both hands: what nobody is told."""
    frames = {"torso": (np.eye(3), np.zeros(3))}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        frames[f"{side}0"] = turn(0, -sign * 1.5 + 0.2 * rng.normal()), [0.0, sign * 0.15, 0.25]
        for i in range(1, 6):
            tilt = turn(0, (-1) ** i * 1.57 + 0.1 * rng.normal()) @ turn(1, 0.1 * rng.normal())
            frames[f"{side}{i}"] = tilt, [0.02, 0.01, 0.1 * rng.uniform(0.6, 1.4)]
    hands = {f"{s}_tag{k}": (f"{s}5", 0.05 * rng.normal(size=3)) for s in ("left", "right")
             for k in range(TAGS)}  # fmt: skip
    return frames, hands


def place(frames, hands, q):
    """Where the tags are."""
    links = {"world": (np.eye(3), np.zeros(3))}
    for (joint, parent), angle in zip(JOINTS, q, strict=True):
        R, p = links[parent]
        X, t = frames[joint]
        links[joint] = R @ X @ turn(2, angle), R @ t + p
    return {name: links[on][0] @ at + links[on][1] for name, (on, at) in hands.items()}


def pixel(camera, p):
    """Where a camera sees a point."""
    z = np.array([0.1, 0.0, 0.3]) - camera
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 0.0, -1.0], z)
    x /= np.linalg.norm(x)
    X, Y, Z = np.array([x, np.cross(z, x), z]) @ (p - camera)
    return 320.0 + FOCAL * X / Z, 240.0 + FOCAL * Y / Z


def write(folder, rng):
    """Write dataset.yaml, poses.csv and observations.csv."""
    frames, hands = body(rng)
    Path(folder).mkdir()
    lines = ["format: nico-dataset/2", "name: two_arms", "joints:"]
    lines += [
        f"- {{name: {joint}, parent: {parent}, encoder_unit: rad}}" for joint, parent in JOINTS
    ]
    lines += ["markers:", *(f"- {{name: {name}, on: {on}}}" for name, (on, _) in hands.items())]
    lens = f"{{fx: {FOCAL}, fy: {FOCAL}, cx: 320, cy: 240}}"
    lines += ["sensors:", "- {name: ruler, kind: distance, sigma_m: 0.0001}"]
    lines += [
        f"- {{name: {c}, kind: camera, image_size: [640, 480], lens: {lens}}}" for c in CAMERAS
    ]
    Path(folder, "dataset.yaml").write_text("\n".join(lines) + "\n")
    poses, seen = [], []
    for a, b in (
        ("left_tag0", "left_tag1"),
        ("right_tag0", "right_tag1"),
        ("left_tag2", "left_tag3"),
    ):
        seen.append(["", "ruler", a, b, "", "", np.linalg.norm(hands[a][1] - hands[b][1])])
    for sample in range(POSES):
        q = rng.uniform(-1.0, 1.0, len(JOINTS)) * [0.4, *[1.0] * 12]
        poses.append([sample, *q])
        for name, p in place(frames, hands, q + np.radians(0.05) * rng.normal(size=13)).items():
            for camera, at in CAMERAS.items():
                u, v = pixel(np.array(at), p) + 0.3 * rng.normal(size=2)
                if 0.0 < u < 640.0 and 0.0 < v < 480.0:
                    seen.append([sample, camera, name, "", u, v, ""])
    columns = ["sample", *(f"encoder.{joint}" for joint, _ in JOINTS)]
    for name, rows in (("poses", [columns, *poses]), ("observations", [[
        "sample", "sensor", "marker", "other", "u", "v", "distance_m"], *seen])):  # fmt: skip
        with Path(folder, f"{name}.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)


if __name__ == "__main__":
    write(sys.argv[1] if len(sys.argv) > 1 else "two_arms", np.random.default_rng(1))
