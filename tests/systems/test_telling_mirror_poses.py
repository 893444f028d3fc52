"""Of many poses before a mirror those are taken that tell most of where it stands."""

import numpy as np
import pytest

from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.planning.body_before_mirror import BodyBeforeMirror
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.telling_mirror_poses import most_telling
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR
from nico_selfmodel.sessions.whole_body import attached_in_room, room_about_nico
from nico_selfmodel.systems.looking import looking_body

CARD = "right_hand_fiducial"


@pytest.fixture(scope="module")
def before():
    view = BodyView(looking_body(), attached_in_room(room_about_nico()))
    return BodyBeforeMirror.of(view, DEFAULT_MIRROR, (0.4, 0.3), [CARD], np.random.default_rng(0))


def test_poses_that_are_chosen_show_the_card_in_the_glass(before):
    chosen = before.by_turns([CARD], 4, np.random.default_rng(1), 20)
    first = before.by_turns([CARD], 20, np.random.default_rng(1))
    q, drawn = (np.array([one for _, one in turns]) for turns in (chosen, first))
    card = before.view.body.tree.marker_index(CARD)
    assert before.seen(q)[:, :, card].all()
    same = (drawn[None] == q[:, None]).all(axis=2)
    assert (same.sum(axis=1) == 1).all()
    assert sorted(same.argmax(axis=1).tolist()) != [0, 1, 2, 3]


def test_a_pose_in_which_nothing_is_seen_in_the_glass_is_not_taken(before):
    q = before.poses([CARD], 6, np.random.default_rng(2))
    tree = before.view.tree
    posture = before.view.posture(q)
    seen = np.zeros((6, 2, len(tree.markers)), dtype=bool)
    reflected = seen.copy()
    reflected[:, :, tree.marker_index(CARD)] = np.arange(6)[:, None] >= 3
    glass = StandingMirror("glass", before.glass.plane)
    rows = most_telling(tree, glass, posture, seen, reflected, 3)
    assert sorted(rows.tolist()) == [3, 4, 5]


def test_seeing_the_room_beside_a_glass_tells_more_of_it(before):
    q = np.repeat(before.poses([CARD], 1, np.random.default_rng(3)), 2, axis=0)
    tree = before.view.tree
    reflected = np.zeros((2, 2, len(tree.markers)), dtype=bool)
    reflected[:, :, tree.marker_index(CARD)] = True
    direct = np.zeros_like(reflected)
    direct[1] = before.view.seen(q)[1] & (np.arange(len(tree.markers)) >= 6)
    assert direct.any()
    glass = StandingMirror("glass", before.glass.plane)
    rows = most_telling(tree, glass, before.view.posture(q), direct, reflected, 1)
    assert rows.tolist() == [1]
