"""What a simulated arm shows, searched for the numbers that it must not show."""

import copy
import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.mechanics import gravity_torques
from nico_selfmodel.systems.simulated.robot import SimulatedRobot

ARM = ArmDescription.named("nico")
QUIET = IMPERFECTIONS["clean"]


def body(world=QUIET, seed=5, session=0, markers=1):
    chain = ARM.chain
    if markers > 1:
        hands = chain.p_WH_zero[0] + 0.03 * np.arange(markers)[:, None]
        names = tuple(f"marker_{k}" for k in range(markers))
        chain = replace(chain, markers=names, p_WH_zero=hands)
    return SimulatedRobot.under_motion_capture(replace(ARM, chain=chain), world, seed, session)


def commands(arm, count, seed=0):
    low = np.array([joint.lower for joint in arm.joints])
    high = np.array([joint.upper for joint in arm.joints])
    return np.random.default_rng(seed).uniform(low, high, (count, len(low)))


def hidden(arm):
    """Return chain, servos and the tracker's place."""
    truth = arm.ground_truth.instance
    return [truth.mechanics.chain, truth.mechanics.servos, truth.X_TB]


def numbers_in(thing, depth=0):
    """Return every number that can be reached through public names, but for the one door."""
    if depth > 6 or callable(thing) or isinstance(thing, str | bytes | None):
        return []
    if isinstance(thing, int | float | np.ndarray | np.generic):
        array = np.asarray(thing)
        return np.asarray(array, dtype=float).ravel().tolist() if array.dtype.kind in "fiu" else []
    if isinstance(thing, Mapping):
        return [x for value in thing.values() for x in numbers_in(value, depth + 1)]
    if isinstance(thing, list | tuple | set | frozenset):
        return [x for value in thing for x in numbers_in(value, depth + 1)]
    names = [f.name for f in fields(thing)] if is_dataclass(thing) else dir(thing)
    public = [name for name in names if not name.startswith("_") and name != "ground_truth"]
    return [x for name in public for x in numbers_in(getattr(thing, name), depth + 1)]


@pytest.mark.parametrize("world", ["clean", "thesis"])
def test_no_public_number_is_one_of_the_truth(world):
    arm = body(IMPERFECTIONS[world])
    chain, servos, to_tracker = hidden(arm)
    truth = [chain.directions, chain.points, chain.p_WH_zero, servos.gear, servos.offset]
    truth = np.concatenate([np.ravel(part) for part in [*truth, to_tracker[:3]]])
    # Ones and zeros are nobody's secret.
    truth = truth[np.abs(truth - np.round(truth)) > 1e-6]
    shown = numbers_in(arm) + [
        x for command in commands(arm, 20) for x in numbers_in(arm.move_and_measure(command))
    ]
    assert len(truth) > 30
    assert len(shown) > 100
    distance = np.abs(np.array(shown)[:, None] - truth).min()
    assert distance > 1e-7


def test_the_individual_is_not_what_its_description_says():
    chain, servos, to_tracker = hidden(body())
    assert np.linalg.norm(chain.points - ARM.chain.points, axis=1).min() > 1e-5
    assert np.abs(servos.gear - [1.0, 1.0, 1.0, 1.6]).min() > 1e-5
    assert servos.gear[-1] == pytest.approx(1.6, rel=0.05)
    assert np.abs(servos.offset).min() > 1e-3
    assert not np.allclose(to_tracker, np.eye(4))


def test_stops_and_a_description_tell_gears_and_zeros_only_roughly():
    """A real robot's stops lie near the limits of its description, not on them."""
    for seed in range(3):
        arm = body(seed=seed)
        turn = 2.0 * np.pi / arm.joints[0].counts_per_turn
        low, high = (
            turn * np.array([getattr(j, k) for j in arm.joints]) for k in ("lower", "upper")
        )
        gear = (high - low) / (ARM.upper - ARM.lower)
        zero = low - gear * ARM.lower
        servos = hidden(arm)[1]
        assert np.abs(gear / servos.gear - 1.0).min() > 1e-5
        assert np.abs(zero - servos.offset).min() > np.radians(0.01)


def test_no_method_takes_or_gives_joint_angles():
    public = [name for name in dir(SimulatedRobot) if not name.startswith("_")]
    methods = [name for name in public if inspect.isfunction(getattr(SimulatedRobot, name))]
    assert methods == ["move_and_measure", "relive"]
    observation = body().move_and_measure(np.zeros(4))
    assert {f.name for f in fields(observation)} == {"encoders", "points"}
    with pytest.raises(TypeError):
        observation.points["hand"] = np.zeros(3)


def test_what_is_seen_cannot_be_used_to_change_the_body():
    arm, twin = body(), body()
    command = commands(arm, 1)[0]
    first = arm.move_and_measure(command)
    first.encoders[:] = 0.0
    first.points["hand"][:] = 0.0
    command[:] = 0.0
    command = commands(arm, 1)[0]
    twin.move_and_measure(command)
    assert np.array_equal(
        arm.move_and_measure(command).points["hand"], twin.move_and_measure(command).points["hand"]
    )


def test_one_individual_lives_in_many_worlds_and_sessions():
    a, b = body(QUIET, seed=3, session=0), body(IMPERFECTIONS["thesis"], seed=3, session=8)
    for mine, theirs in zip(hidden(a)[:1], hidden(b)[:1], strict=True):
        assert np.array_equal(mine.points, theirs.points)
    other = hidden(body(QUIET, seed=4))[0]
    assert not np.allclose(other.points, hidden(a)[0].points)


def test_encoders_are_whole_counts_between_the_stops():
    arm = body(IMPERFECTIONS["thesis"])
    low = np.array([joint.lower for joint in arm.joints])
    high = np.array([joint.upper for joint in arm.joints])
    for command in commands(arm, 50) * 1.6:
        read = arm.move_and_measure(command).encoders
        assert np.array_equal(read, np.round(read))
        assert np.array_equal(read, np.clip(np.round(command), low, high))
    assert np.array_equal(low, np.round(low))
    assert {joint.counts_per_turn for joint in arm.joints} == {16384}


def test_play_is_as_wide_as_the_world_says_and_centred():
    """At one pose the hand's scatter is that of the angles, uniform in +-play, times the arm."""
    world = replace(QUIET, play=np.radians(0.5))
    arm = body(world)
    still = body()
    command = commands(arm, 1, seed=3)[0]
    center = still.move_and_measure(command).points["hand"]
    seen = np.array([arm.move_and_measure(command).points["hand"] for _ in range(600)])
    chain, servos, to_tracker = hidden(arm)
    q = servos.to_joint(still.move_and_measure(command).encoders)
    step = 1e-6
    moved = np.stack([chain.forward(q + step * unit) - chain.forward(q) for unit in np.eye(4)])
    slopes = moved / step @ to_tracker[:3, :3].T
    expected = np.radians(0.5) ** 2 / 3.0 * slopes.T @ slopes
    found = np.cov(seen.T)
    assert np.trace(found) == pytest.approx(np.trace(expected), rel=0.1)
    assert seen.mean(axis=0) == pytest.approx(center, abs=4.0 * np.sqrt(np.trace(found) / 600))


def test_markers_are_noisy_and_lost_each_on_its_own():
    world = replace(QUIET, marker_sigma=1e-3, dropout_share=0.3)
    arm, still = body(world, markers=3), body(markers=3)
    command = commands(arm, 1, seed=3)[0]
    exact = still.move_and_measure(command).points
    observations = [arm.move_and_measure(command).points for _ in range(400)]
    lost = np.array([[points[m] is None for m in arm.markers] for points in observations])
    assert lost.mean() == pytest.approx(0.3, abs=0.05)
    assert np.abs(np.corrcoef(lost.T)[np.triu_indices(3, 1)]).max() < 0.15
    noise = np.concatenate(
        [
            points[m] - exact[m]
            for points in observations
            for m in arm.markers
            if points[m] is not None
        ]
    )
    assert noise.std() == pytest.approx(1e-3, rel=0.06)
    assert noise.mean() == pytest.approx(0.0, abs=1e-4)


def test_only_the_shoulder_wobbles_and_only_now_and_then():
    world = replace(QUIET, wobble=np.radians(1.0), wobble_share=0.2)
    arm, still = body(world), body()
    command = commands(arm, 1, seed=3)[0]
    center = still.move_and_measure(command).points["hand"]
    off = np.array([arm.move_and_measure(command).points["hand"] - center for _ in range(500)])
    loose = np.linalg.norm(off, axis=1) > 1e-9
    assert loose.mean() == pytest.approx(0.2, abs=0.06)
    # Two joints move the hand in a plane, to first order.
    values = np.linalg.svd(off[loose], compute_uv=False)
    assert values[2] < 0.1 * values[1]


def test_gravity_pulls_along_minus_z_and_not_on_vertical_axes():
    chain = copy.deepcopy(ARM.chain)
    upright = replace(chain, directions=np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert gravity_torques(upright, np.zeros(4)) == pytest.approx(np.zeros(4), abs=1e-12)
    lever = replace(
        chain,
        directions=np.tile([0.0, 1.0, 0.0], (4, 1)),
        points=np.zeros((4, 3)),
        p_WH_zero=np.array([[0.3, 0.0, 0.0]]),
    )
    # A weight in front turns about y by the right hand, down.
    assert gravity_torques(lever, np.zeros(4)) == pytest.approx(np.full(4, 0.3))
    hanging = gravity_torques(lever, np.array([np.pi / 2, 0.0, 0.0, 0.0]))
    assert hanging == pytest.approx(np.zeros(4), abs=1e-12)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [([-1.0] * 4, [-1.0] * 4), ([0.0] * 4, [1.0, 1.0, -1.0, 1.0]), ([-np.inf] * 4, [1.0] * 4)],
)
def test_stops_that_are_none_are_refused(lower, upper):
    with pytest.raises(ValueError, match="finite lower < upper"):
        SimulatedRobot.under_motion_capture(
            replace(ARM, lower=np.array(lower), upper=np.array(upper)), QUIET, 0
        )
