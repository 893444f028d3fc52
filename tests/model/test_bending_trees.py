"""What bends in a tree: what it carries, and that a chain is a tree without branches."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.model.arm.bending import LOADS, PARTS, SAG, Bending
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.loaded_posture import loaded
from nico_selfmodel.model.arm.uniform_rods import uniform_rods
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE, Attached, BodyTree
from nico_selfmodel.model.tree.spread_weight import tree_rods
from nico_selfmodel.model.tree.tree_motion import TreeMotion

UP = np.array([0.0, 0.6, 0.8])


@pytest.fixture
def table(make_chain):
    return DhTable.from_chain(make_chain(["generic", "intersecting", "parallel", "generic"], 3, 2))


def tree_of(table, bending=None):
    """The same arm as a tree: each joint frame at its zero, links turn with their joints."""
    n = len(table.joints)
    at = table.joint_motions(np.zeros(n))
    turn = np.tile(np.eye(4), (n, 1, 1))
    turn[:, :3, :3] = rotation_about(np.eye(3)[2], table.theta_zero)
    lifted = at @ np.linalg.inv(np.tile(np.eye(4), (n, 1, 1)))
    rows = lifted @ turn @ table.links
    X_PJ = np.stack([table.X_W0, *rows[:-1]])
    last = rows[-1]
    markers = tuple(
        Attached(f"m{k}", n - 1, last @ np.block([[np.eye(3), p[:, None]], [np.zeros(3), 1.0]]))
        for k, p in enumerate(table.p_NH)
    )
    return BodyTree(
        table.joints,
        (REVOLUTE,) * n,
        np.arange(-1, n - 1),
        X_PJ,
        np.ones(n),
        np.eye(n),
        markers,
        (),
        bending=bending,
    ), rows


def carried_over(bending, rows):
    """What bends, with loads in the tree's link frames, which turn where the table's end."""
    loads = np.einsum("nij,nj->ni", rows[:, :3, :3], bending.loads)
    still = Bending.none(bending.joints, bending.up, loads, bending.pivots)
    moved = still.with_effects(*bending.effects)
    values = dict(zip(bending.names, bending.values, strict=True))
    values |= dict(zip(moved.with_effects(LOADS).names, loads.ravel(), strict=True))
    return moved.with_values(np.array([values[name] for name in moved.names]))


def test_a_chain_bends_like_a_tree_without_branches(table):
    rng = np.random.default_rng(0)
    still = Bending.none(table.joints, UP, *uniform_rods(table)).with_effects(*PARTS)
    bending = still.with_values(still.values + 1e-2 * rng.normal(size=len(still.values)))
    q = rng.uniform(-2, 2, (30, len(table.joints)))
    side = rng.choice([-1.0, 0.0, 1.0], q.shape)
    p = loaded(table, bending, q, side).points(table.p_NH[0])
    tree, rows = tree_of(table)
    tree, _ = tree_of(table, carried_over(bending, rows))
    motion = TreeMotion.at(tree, q, approach=side)
    assert pytest.approx(p, abs=1e-12) == motion.pose_of(tree.markers[0])[1].T


def test_rods_of_a_chain_are_those_of_the_arm(table):
    tree, rows = tree_of(table)
    loads, pivots = tree_rods(TreeMotion.at(tree, np.zeros((1, len(table.joints)))))
    expected, places = uniform_rods(table)
    assert loads == pytest.approx(np.einsum("nij,nj->ni", rows[:, :3, :3], expected))
    assert pivots == pytest.approx(places)


def two_arms(coupling=None, motions=(REVOLUTE,) * 5):
    """A lying waist (x axis), and two arms of two joints each that hang from it."""
    X = np.tile(np.eye(4), (5, 1, 1))
    lie = rotation_about(np.eye(3)[1], np.pi / 2.0)
    X[0, :3, :3] = lie
    for i, side in ((1, 1.0), (3, -1.0)):
        X[i, :3, 3] = lie.T @ [0.0, 0.2 * side, 0.4]
        X[i + 1, :3, 3] = lie.T @ [0.0, 0.3 * side, 0.0]
    ends = []
    for i, side in ((2, 1.0), (4, -1.0)):
        X_LA = np.eye(4)
        X_LA[:3, 3] = lie.T @ [0.0, 0.1 * side, 0.0]
        ends.append(Attached(f"hand{i}", i, X_LA))
    names = ("waist", "r1", "r2", "l1", "l2")
    return BodyTree(
        *(names, motions, np.array([-1, 0, 1, 0, 3]), X, np.ones(5)),
        *(np.eye(5) if coupling is None else coupling, tuple(ends), ()),
    )


def moved(tree, q, effect=SAG, **values):
    loads, pivots = tree_rods(TreeMotion.at(tree, np.zeros((1, 5))))
    still = Bending.none(tree.joints, np.eye(3)[2], loads, pivots).with_effects(effect)
    known = dict.fromkeys(still.names, 0.0) | {f"{k}.{effect}": v for k, v in values.items()}
    bending = still.with_values(np.array([known[name] for name in still.names]))
    motion = TreeMotion.at(replace(tree, bending=bending), q)
    return motion.q.T - TreeMotion.at(tree, q).q.T


def test_an_arm_that_reaches_out_bends_the_waist_and_one_on_each_side_balances_it():
    tree = two_arms()
    level = np.zeros((1, 5))
    both = moved(tree, level, waist=0.1)[0]
    assert abs(both[0]) < 1e-12
    lifted = level.copy()
    lifted[0, 3] = 1.2
    one = moved(tree, lifted, waist=0.1)[0]
    assert abs(one[0]) > 3e-3
    assert not one[1:].any()


def test_the_shoulder_does_not_feel_the_other_arm():
    tree = two_arms()
    q = np.zeros((2, 5))
    q[1, 3:] = 1.0, 0.5
    turns = moved(tree, q, r1=0.1)
    assert turns[0, 1] == pytest.approx(turns[1, 1], abs=1e-15)
    assert abs(turns[0, 1]) > 1e-3


def test_a_drive_feels_what_its_follower_carries():
    alone = two_arms()
    coupling = np.eye(5)
    coupling[2] = [0.0, -1.0, 0.0, 0.0, 0.0]
    tied = two_arms(coupling)
    q = np.zeros((1, 5))
    shoulder = moved(alone, q, r1=0.1)[0, 1]
    elbow = moved(alone, q, r2=0.1)[0, 2]
    together = moved(tied, q, r1=0.1)[0]
    assert together[1] == pytest.approx(shoulder - elbow)
    assert together[2] == pytest.approx(-together[1])


def test_joints_that_shift_do_not_bend():
    tree = two_arms(motions=(PRISMATIC, *(REVOLUTE,) * 4))
    assert not moved(tree, np.full((1, 5), 0.3), waist=0.5).any()
