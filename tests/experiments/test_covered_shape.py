"""What the moving arm may cover in a picture is of no shape that is learned from it."""

from types import MappingProxyType, SimpleNamespace

import numpy as np

from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.looks.expecting import Expecting, Unknown
from nico_selfmodel.sessions.mirrors import learned_shape
from nico_selfmodel.sessions.mirrors.shape_looks import ShapeLooks
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.cropped_render import LabelledPicture

ARM, CHEST = 7, 3
ROOM = np.array([90.0, 80.0, 70.0])
MIRROR = Mirror.from_values([0.0, -0.3, 0.3])


def test_a_hand_held_up_may_cover_more_about_it_than_its_reflection():
    labels = np.full((200, 300), CHEST)
    labels[100, 80], labels[100, 200] = ARM, ARM
    depth = np.full(labels.shape, 0.9)
    depth[100, 80], depth[100, 200] = 0.3, 1.2
    seen = LabelledPicture(np.zeros((200, 300, 4), np.uint8), depth, labels)
    image = SimpleNamespace(moving=(ARM,), links={ARM: "hand", CHEST: "chest"})
    expecting = Expecting(image, NICO_CAMERAS, MIRROR, (2.0, 2.0), Unknown())
    found = expecting.covered(0, seen)
    reach = [np.ptp(np.flatnonzero(found[100, part])) / 2 for part in (slice(140), slice(140, 300))]
    fx = NICO_CAMERAS.left.fx
    np.testing.assert_allclose(reach, np.ceil(2.5 * fx * 3e-3 / np.array([0.3, 1.2])) + 1)
    assert not found[:60].any()


def test_what_is_strange_without_a_mark_is_not_judged_by_the_expected_body():
    labels = np.full((200, 300), CHEST)
    seen = LabelledPicture(np.zeros((200, 300, 4), np.uint8), np.full(labels.shape, 0.9), labels)
    image = SimpleNamespace(moving=(ARM,), links={ARM: "hand", CHEST: "chest"})
    odd = np.zeros(labels.shape, dtype=bool)
    odd[50:54, 60:63] = True
    unknown = Unknown({"chest": 2.5e-4}, strange=(odd, np.zeros_like(odd)))
    left, right = (
        Expecting(image, NICO_CAMERAS, MIRROR, (2.0, 2.0), unknown).pixel_sigma(side, seen)
        for side in (0, 1)
    )
    assert np.array_equal(np.isnan(left), odd)
    assert np.isfinite(right).all()


def test_a_covered_part_is_neither_body_nor_room(monkeypatch):
    monkeypatch.setattr(learned_shape, "mirrors_and_cameras", lambda *_: ((), np.eye(3)))
    picture = np.tile(ROOM, (240, 320, 1))
    picture[60:180, 100:220] = [40.0, 160.0, 200.0]
    picture[100:140, 180:260] = [230.0, 230.0, 230.0]  # a hand before the chest and beside it
    pictures = (picture.astype(np.uint8),) * 2
    arm = np.zeros(picture.shape[:2], dtype=bool)
    arm[95:145, 175:265] = True
    room = np.tile(ROOM, (240, 320, 1)).astype(np.uint8)
    looks = ShapeLooks(
        MappingProxyType({"glass": MIRROR}), (SimpleNamespace(pictures=pictures),),
        ((arm, np.zeros_like(arm)),), room, (1.0, 1.0),
    )  # fmt: skip
    model = SimpleNamespace(rig=NICO_CAMERAS)
    left, right = learned_shape.outlined(looks, model, None, None, ()).views
    assert np.isnan(left.beyond[arm]).all()
    assert np.array_equal(left.beyond[~arm], right.beyond[~arm])
    assert np.isfinite(right.beyond).all()
    assert (right.beyond[arm] < 0.0).any()
    assert left.beyond[80, 150] < 0.0 < left.beyond[20, 20]
