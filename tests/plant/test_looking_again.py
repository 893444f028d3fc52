"""A point that is seen off the middle is looked at where it is seen, in the mean over looks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.plant.looking.again import SeenOff, seen_place
from nico_selfmodel.plant.looking.gaze import GazeSolver
from nico_selfmodel.systems.looking import looking_body

from ..slow_rest import slow_rest


def two_cameras():
    """Two lenses of a Nico side by side, looking along x."""
    lenses = looking_body().tree.lenses
    R = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return {
        name: lens.at(transform(R @ rotation_from_vector([0.0, 0.05, 0.0]), [0.0, y, 0.0]))
        for (name, lens), y in zip(lenses.items(), (0.035, -0.035), strict=True)
    }


near = st.floats(-0.03, 0.03)


@given(x=near, y=near, z=near)
def test_two_lines_of_sight_tell_a_place_whatever_was_expected(x, y, z):
    expected = np.array([0.4, 0.02, 0.03])
    cameras, place = two_cameras(), expected + np.array([x, y, z])
    pixels = {name: camera.project(place) for name, camera in cameras.items()}
    found = seen_place(cameras, pixels, expected)
    assert found == pytest.approx(place, abs=5e-4)


def test_one_line_of_sight_tells_the_direction_and_keeps_the_distance():
    cameras = two_cameras()
    name, camera = next(iter(cameras.items()))
    expected, place = np.array([0.5, 0.0, 0.0]), np.array([0.53, 0.01, -0.02])
    pixels = {other: np.full(2, np.nan) for other in cameras} | {name: camera.project(place)}
    found = seen_place(cameras, pixels, expected)
    assert camera.project(found) == pytest.approx(pixels[name], abs=0.2)
    way = camera.directions(camera.project(place)[None])[0]
    world = camera.X_WC[:3, :3] @ way
    assert world @ (found - expected) == pytest.approx(0.0, abs=3e-3)


def test_what_no_camera_sees_has_no_place():
    cameras = two_cameras()
    unseen = {name: np.full(2, np.nan) for name in cameras}
    assert seen_place(cameras, unseen, np.array([0.5, 0.0, 0.0])) is None
    assert seen_place(cameras, {}, np.array([0.5, 0.0, 0.0])) is None


def test_looks_count_alike_until_old_ones_fade():
    rng = np.random.default_rng(0)
    offsets, off = rng.normal(0.0, 1.0, (10, 3)), SeenOff()
    for one in offsets:
        off = off.after(one)
    assert off.looks == 10
    assert off.offset == pytest.approx(offsets.mean(axis=0))
    for _ in range(60):
        off = off.after([1.0, 2.0, 3.0])
    assert off.offset == pytest.approx([1.0, 2.0, 3.0], abs=0.02)


def test_a_body_looks_at_where_it_saw_what_it_expected_elsewhere():
    body = looking_body()
    solver = GazeSolver(BodyModel("nico", body.tree, np.ones(18), limits=body.limits))
    now, expected = np.zeros(18), np.array([0.6, 0.1, 0.45])
    place = expected + np.array([0.01, -0.02, 0.015])
    first = solver.at_point(now, expected)
    pixels = {n: c.project(place) for n, c in solver._cameras(first.readings).items()}
    off = solver.again(first.readings, expected, pixels)
    second = solver.at_point(first.readings, expected + off.offset)
    cameras = solver._cameras(second.readings)
    seen = {name: camera.project(place) for name, camera in cameras.items()}
    assert solver.off_middle(pixels)[0] > 10.0
    assert solver.off_middle(seen)[0] < 2.0


def test_pixels_of_what_does_not_look_are_refused():
    body = looking_body()
    model = BodyModel("nico", body.tree, np.ones(18), limits=body.limits)
    one = GazeSolver(model, ["left_wide_camera"])
    p = [0.6, 0.0, 0.4]
    with pytest.raises(ModelError, match="no camera right_wide_camera looks"):
        one.again(np.zeros(18), p, {"right_wide_camera": [1.0, 2.0]})
    with pytest.raises(ValueError, match="its image is 640 x 480 px"):
        one.again(np.zeros(18), p, {"left_wide_camera": [641.0, 2.0]})
    with pytest.raises(ValueError, match=r"expected shape \(2,\)"):
        one.again(np.zeros(18), p, {"left_wide_camera": [641.0]})
    before = SeenOff(np.ones(3), 2)
    assert one.again(np.zeros(18), p, {"left_wide_camera": [np.nan, 3.0]}, before) is before


@pytest.mark.parametrize("turn", slow_rest([0, 1, 2]))
def test_the_place_does_not_hang_on_the_frame_of_the_world(turn):
    X = transform(rotation_from_vector(np.random.default_rng(turn).normal(size=3)), [1.0, 2.0, 3.0])
    cameras, expected = two_cameras(), np.array([0.4, 0.02, 0.03])
    pixels = {name: camera.project(expected + 0.01) for name, camera in cameras.items()}
    moved = {name: replace(camera, X_WC=X @ camera.X_WC) for name, camera in cameras.items()}
    there = X[:3, :3] @ expected + X[:3, 3]
    found = X[:3, :3] @ seen_place(cameras, pixels, expected) + X[:3, 3]
    assert seen_place(moved, pixels, there) == pytest.approx(found, abs=1e-7)
