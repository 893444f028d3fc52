"""The arm that moves is judged where it was seen to stand: what of it is, and what is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.body_alignment import BodyMotion
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.sessions.looks.expecting import Expecting, Unknown
from nico_selfmodel.sessions.looks.least_unknown import MOVING, POINTS, Told, least_unknown
from nico_selfmodel.sessions.looks.mark_finder import LINK_SIGMA, MarkFinder
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.looks.seen_arm import SeenArm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.body_image import NOTHING, ExpectedPicture
from nico_selfmodel.systems.rendering.cropped_render import LabelledPicture
from nico_selfmodel.vision.surprise.blobs import Blob

CHEST, ARM, HAND = 3, 7, 9
LINKS = {CHEST: "chest", ARM: "arm", HAND: "hand"}
MIRROR = Mirror.from_values([0.0, -0.3, 0.3])
SHAPE = (200, 300)
IMAGE = SimpleNamespace(
    moving=frozenset({ARM, HAND}), links=LINKS, surfaces={}, poses=lambda readings: {}
)
UNKNOWN = Unknown(dict.fromkeys(LINKS.values(), 2.5e-4))


def picture(step=0.05):
    """Return an arm before a chest, so far before it in the lower half, and a hand beside both."""
    labels, depth = np.full(SHAPE, CHEST), np.full(SHAPE, 1.0)
    labels[:, 100:140] = ARM
    depth[:, 100:140] = 1.0 - step
    labels[80:120, 200:260], depth[80:120, 200:260] = HAND, 0.9
    labels[:, 280:] = NOTHING
    depth[:, 280:] = np.inf
    return LabelledPicture(np.zeros((*SHAPE, 4), np.uint8), depth, labels)


def seen(sigma_q=0.0, attached=None):
    """Return an arm that turns as a whole, known to so much."""
    motion = BodyMotion(np.array([0.0, 0.0, 1.0]), np.zeros(3)), frozenset({"arm", "hand"})
    nothing = np.zeros(SHAPE, dtype=bool)
    hidden = nothing if attached is None else attached
    return SeenArm(
        np.zeros(1), np.array([[sigma_q**2]]), np.zeros(1), [motion], (hidden, nothing),
        frozenset({"hand"}),
    )  # fmt: skip


def sigma_of(arm, labelled=None, unknown=UNKNOWN, image=IMAGE):
    expecting = Expecting(image, NICO_CAMERAS, MIRROR, (2.0, 2.0), unknown)
    return expecting.pixel_sigma(0, picture() if labelled is None else labelled, arm)


def test_an_arm_that_was_seen_is_judged_and_one_that_was_not_is_not():
    without, known = sigma_of(None), sigma_of(seen())
    assert np.isnan(without[:, 95:145]).all()
    assert np.isfinite(known[5:70, 60:180]).all()
    assert np.isfinite(without[5:70, 60:80]).all()


@pytest.mark.parametrize(("link", "apart", "judged"), [
    ("hand", 1.3, False),  # root 2 of what each is not known by: either may be before the other
    ("hand", -1.3, False),
    ("hand", 1.5, True),
    ("arm", 1.3, True),  # itself
    ("chest", 1.3, True),  # which stands, and was seen as it is
])  # fmt: skip
def test_an_arm_is_not_judged_where_another_of_its_links_lies_as_near_as_they_are_known(
    link, apart, judged
):
    row, column, radius, sigma = 40, 120, 0.02, 2.5e-4
    behind = NICO_CAMERAS.left.at_depth([[column, row]] * 2, [0.95, 0.96])
    place, beyond = reflect(MirrorRig(NICO_CAMERAS, MIRROR).plane, behind)
    way = (beyond - place) / np.linalg.norm(beyond - place)
    X_WF, X_FS = np.eye(4), np.eye(4)
    X_WF[:3, 3] = [0.2, -0.1, 0.3]
    X_FS[:3, 3] = place - X_WF[:3, 3] + (radius + apart * sigma) * way
    surface = LinkSurface(None, (Solid("ellipsoid", (radius,) * 3, X_FS),), np.ones((1, 3)))
    image = SimpleNamespace(
        moving=IMAGE.moving, links=LINKS, surfaces={link: surface}, poses=lambda _: {link: X_WF}
    )
    found = sigma_of(seen(), image=image)
    assert np.isfinite(found[row, column]) == judged
    assert np.isfinite(found[row, column - 15])  # 20 mm beside it


def test_an_arm_known_by_more_than_a_pixel_is_not_judged():
    assert np.isfinite(sigma_of(seen(1e-3))[5:70, 110:130]).all()
    assert np.isnan(sigma_of(seen(1e-2))[5:70, 110:130]).all()


def test_what_an_arm_may_hide_or_not_is_known_as_well_as_the_arm():
    known = sigma_of(seen(1e-3))
    own = known[50, 120]
    assert own > known[50, 60]
    beside = int(np.ceil(2.5 * own)) + 1
    assert (known[50, 100 - beside : 100] >= own).all()
    assert known[50, 100 - beside - 2] == known[50, 60]


def test_the_hand_and_what_is_attached_to_it_are_not_judged():
    attached = np.zeros(SHAPE, dtype=bool)
    attached[20:30, 110:120] = True
    known = sigma_of(seen(attached=attached))
    assert np.isnan(known[80:120, 200:260]).all()
    assert np.isnan(known[20:30, 110:120]).all()
    assert np.isfinite(known[40:60, 110:130]).all()


def test_a_link_of_which_nothing_was_told_is_not_judged():
    untold = Unknown(dict(UNKNOWN.points), untold=frozenset({"arm"}))
    assert np.isnan(sigma_of(seen(), unknown=untold)[:, 100:140]).all()


@pytest.mark.parametrize(
    ("level", "light"), [(204, 0.01745), (102, 0.0349), (0, 0.8 * 0.01745 / 0.01)]
)
def test_a_link_that_moves_may_be_turned_a_degree_to_the_light_which_is_more_in_the_shade(
    level, light
):
    """The share of what is seen grows where little is: paint of 0.8 turns by a degree."""
    one = picture()
    color = np.full((*SHAPE, 4), level, np.uint8)
    lit = ExpectedPicture(color, one.depth, one.labels, np.zeros(SHAPE, int))
    colors = np.full((1, 3), 0.8)
    image = SimpleNamespace(**vars(IMAGE), colors=colors, paint_sigma=np.array([0.03]))
    found = Expecting(image, NICO_CAMERAS, MIRROR, (2.0, 2.0), UNKNOWN).expected(0, lit, seen())
    np.testing.assert_allclose(found.light_sigma[one.labels == ARM], light, rtol=0.01)
    assert (found.light_sigma[one.labels == CHEST] == 0.0).all()
    np.testing.assert_allclose(found.appearance_sigma, np.hypot(0.03, UNKNOWN.color))


@pytest.mark.parametrize(("step", "judged"), [(0.05, True), (0.005, False)])
def test_where_arm_and_body_meet_nothing_is_judged_and_where_one_is_before_the_other_it_is(
    step, judged
):
    known = sigma_of(seen(), picture(step))
    assert np.isfinite(known[5:70, 98:103]).all() == judged
    assert np.isfinite(known[5:70, 110:130]).all()


@pytest.mark.parametrize(("strange", "judged"), [(5, True), (6, False)])
def test_an_arm_of_which_one_place_in_twenty_looks_otherwise_stands_elsewhere(
    monkeypatch, strange, judged
):
    looks = MirrorLooks.__new__(MirrorLooks)
    looks._image = IMAGE
    places = np.where(np.arange(100) < strange, 17.0, 16.0)

    def hold(side, picture, readings, arm):
        surprise = SimpleNamespace(chi_square=places if side else np.full(100, np.nan))
        return SimpleNamespace(surprise=surprise, labels=np.full(100, ARM), arm=arm)

    for name, value in {
        "_readings": lambda: np.zeros(1),
        "_pictures": lambda: [None, None],
        "_arm": lambda *_: seen(),
        "_expecting": lambda: SimpleNamespace(judged=hold),
    }.items():
        monkeypatch.setattr(looks, name, value)
    assert all((one.arm is not None) == judged for one in looks.judge())


def told(color):
    """One place of the arm surprises beyond chance unless it is known to 1 mm, of the hand ever."""
    k = len(POINTS)
    share, alarms = np.zeros((k, 3)), np.zeros((k, 3))
    alarms[np.array(POINTS) < 1e-3, 1] = 1
    alarms[:, 2] = 1
    likely = -np.arange(k)[:, None] * np.ones(3)
    strange = np.full((k, 2, 20, 30), -1)
    strange[:, 0, 5, 5], strange[:, 0, 15, 25] = 0, 1
    links = {"chest": 0, "arm": 1, "hand": 2}
    return Told(likely, share, strange, links, alarms, frozenset({"arm", "hand"}))


def test_nothing_of_a_link_that_moves_is_strange_for_it_is_elsewhere_next_time():
    found = least_unknown(told)
    assert dict(found.points) == {"chest": POINTS[0], "arm": 1e-3}
    assert found.untold == {"hand"}
    assert found.strange[0][5, 5]
    assert not found.strange[0][15, 25]


def test_a_link_that_moves_is_known_no_better_than_thin_things_fall_between_pixels():
    calm = told(0.01)
    quiet = Told(
        calm.likely, calm.share, calm.strange, calm.links, np.zeros_like(calm.alarms), calm.moving
    )
    assert least_unknown(lambda _: quiet).points["arm"] == MOVING == 7e-4


@pytest.mark.parametrize(("beside", "own"), [(0.0, True), (2.0, True), (9.0, True), (15.0, False)])
def test_a_spot_whose_middle_lies_beside_the_arm_is_on_it(beside, own):
    """Paint on an arm before the glass is of the arm, at its outline too, and not on another."""
    finder, labels = MarkFinder(IMAGE, None), picture().labels
    at_edge, far = (Blob(139.0 + u, 30.0, 80, 90.0, reach=5.0) for u in (beside, 35.0))
    pair = SimpleNamespace(labels=labels), SimpleNamespace(labels=labels)
    assert finder._on_arm(pair, at_edge, far) is own
    assert finder._on_arm(pair, far, at_edge) is own


@pytest.mark.parametrize("moved", [True, False])
def test_links_of_arm_and_trunk_may_stand_beside_where_they_are_known_to_and_a_head_does_not(moved):
    links = LINKS | {1: "head"}
    image = SimpleNamespace(
        moving=frozenset({ARM, HAND}), links=links, surfaces={},
        poses=lambda readings: dict.fromkeys(links.values(), np.eye(4)),
    )  # fmt: skip
    motions = ((None, frozenset({"head"})), (None, frozenset(links.values())))
    known = SimpleNamespace(
        mirrors=("m",), covariance=np.diag([1e-6] * 9), motions=lambda _: motions
    )
    look = SimpleNamespace(readings=np.zeros(1), arm=seen() if moved else None)
    body = MarkFinder(image, known)._body("m", look)
    arm = {"arm": LINK_SIGMA, "hand": LINK_SIGMA} if moved else {}  # else it is nowhere
    assert dict(body.place_sigma) == {"head": 0.0, "chest": LINK_SIGMA, **arm}
