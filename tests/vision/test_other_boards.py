"""Boards of all kinds, against photographs of known truth and OpenCV."""

import re
from functools import lru_cache

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.boards.board_kinds import board_of
from nico_selfmodel.vision.boards.tag_layout import lie_on
from nico_selfmodel.vision.images.not_seen import NotSeen, OtherBoard
from nico_selfmodel.vision.markers.tags_seen import TagsSeen

from ..slow_rest import slow_rest
from . import printed_boards

TAGS_5X5 = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
TAGS_36H11 = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
CHARUCO = board_of("charuco:8x6", 30, 22, "aruco_5x5_100")
APRIL = board_of("aprilgrid:6x6", 57.2, 44)
CIRCLES = board_of("circles:8x6", 30, 18)
ASYMMETRIC = board_of("asymmetric-circles:4x11", 20)
CHESS = board_of("9x6", 30)
BOARDS = {
    "chess": CHESS,
    "charuco": CHARUCO,
    "april": APRIL,
    "circles": CIRCLES,
    "asymmetric": ASYMMETRIC,
}
HIDDEN = {
    "chess": (0, 0),
    "charuco": (0.3, 0.7),
    "april": (0.3, 0.7),
    "circles": (0, 0),
    "asymmetric": (0, 0),
}


@pytest.fixture(scope="module")
def prints():
    return {
        "chess": printed_boards.chess_print(9, 6, 0.03),
        "charuco": printed_boards.charuco_print(9, 7, 0.03, 0.022, TAGS_5X5),
        "april": printed_boards.april_print(6, 6, 0.044, 0.3, TAGS_36H11),
        "thin": printed_boards.april_print(6, 6, 0.044, 0.3, TAGS_36H11, border=1),
        "circles": printed_boards.circle_print(CIRCLES.points, 0.018, 0.03),
        "asymmetric": printed_boards.circle_print(ASYMMETRIC.points, 0.02, 0.02),
    }


@pytest.fixture(scope="module")
def photograph(prints):
    """Return the function that takes a picture; tests that ask for the same one share it."""

    @lru_cache(maxsize=8)
    def taken(kind, seed, hidden=None):
        rng = np.random.default_rng((seed, 77))
        share = rng.uniform(*HIDDEN[kind])
        return printed_boards.photographed(
            prints[kind], BOARDS[kind].points, rng, hidden=share if hidden is None else hidden
        )

    return taken


def found_by_opencv(kind, image):
    if kind == "charuco":
        board = cv2.aruco.CharucoBoard((9, 7), 0.03, 0.022, TAGS_5X5)
        _, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
        return ids is not None and len(ids) >= 6
    if kind == "april":
        parameters = cv2.aruco.DetectorParameters()
        parameters.markerBorderBits = 2
        _, ids, _ = cv2.aruco.ArucoDetector(TAGS_36H11, parameters).detectMarkers(image)
        return ids is not None and len(ids) >= 2
    if kind == "chess":
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
        return cv2.findChessboardCorners(image, (9, 6), flags=flags)[0]
    flag = {"circles": cv2.CALIB_CB_SYMMETRIC_GRID, "asymmetric": cv2.CALIB_CB_ASYMMETRIC_GRID}
    size = (BOARDS[kind].columns, BOARDS[kind].rows)
    return cv2.findCirclesGrid(image, size, flags=flag[kind])[0]


def corner_errors(kind, seeds, photograph):
    """Return errors of all points found, and how many pictures we and OpenCV found it in."""
    errors, ours, theirs = [], 0, 0
    for seed in seeds:
        photo = photograph(kind, seed)
        theirs += bool(found_by_opencv(kind, photo.image))
        seen = BOARDS[kind].find(photo.image, 11)
        if isinstance(seen, NotSeen):
            continue
        ours += 1
        error = seen.corners - photo.pixels
        if kind in ("chess", "circles"):  # looks the same after half a turn
            turned = seen.corners[::-1] - photo.pixels
            error = min(error, turned, key=lambda e: np.nanmean(np.abs(e)))
        errors.append(error[seen.seen])
    return np.concatenate(errors), ours, theirs


def assert_true(kind, seeds, photograph):
    errors, ours, theirs = corner_errors(kind, seeds, photograph)
    print(
        f"{kind}: {ours} found, {theirs} by OpenCV, of {len(seeds)}; bias {errors.mean(axis=0)}, "
        f"rms {np.sqrt(np.mean(errors**2)):.4f} px, {len(errors)} points"
    )
    assert ours >= max(theirs, 1)
    assert np.abs(errors.mean(axis=0)).max() <= 0.02
    assert np.sqrt(np.mean(errors**2)) <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOARDS)
def test_points_are_where_they_are(kind, photograph):
    assert_true(kind, range(2), photograph)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(1031, 1032), range(1000, 1040)])
def test_tags_with_borders_of_one_cell_are_found_as_those_of_two(seeds, prints):
    """In the first picture something else looks like a tag with a border of two."""
    errors, found = [], 0
    for seed in seeds:
        rng = np.random.default_rng((seed, 77))
        photo = printed_boards.photographed(
            prints["thin"], APRIL.points, rng, hidden=rng.uniform(*HIDDEN["april"])
        )
        seen = APRIL.find(photo.image, 11)
        if isinstance(seen, NotSeen):
            continue
        assert seen.board == APRIL
        found += 1
        errors.append((seen.corners - photo.pixels)[seen.seen])
    errors = np.concatenate(errors)
    print(f"thin: {found} of {len(seeds)}; bias {errors.mean(axis=0)}, rms {errors.std():.4f} px")
    assert found >= 0.95 * len(seeds)
    assert np.abs(errors.mean(axis=0)).max() <= 0.02
    assert np.sqrt(np.mean(errors**2)) <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOARDS)
def test_200_pictures_as_often_as_opencv_without_bias(kind, photograph):
    assert_true(kind, range(1000, 1200), photograph)


@pytest.mark.parametrize(("room", "seen"), slow_rest([(4, True), (2, False), (8, True)], plain=2))
def test_circles_at_the_edge_are_where_they_are(room, seen, photograph):
    """With so many pixels beyond the circle that is nearest to the image's upper edge."""
    photo = photograph("asymmetric", 2000, 0.0)
    whole = BOARDS["asymmetric"].find(photo.image, 11)
    top = int(photo.pixels[:, 1].argmin())
    u, v = np.rint(photo.pixels[top]).astype(int)
    radius = int(np.argmax(photo.image[v::-1, u] > 120))
    cut = v - radius - room
    found = BOARDS["asymmetric"].find(np.ascontiguousarray(photo.image[cut:]), 11)
    assert found.seen[top] == seen
    assert np.delete(found.seen, top).all()
    moved = found.corners + np.array([0.0, cut]) - whole.corners
    assert np.nanmax(np.abs(moved)) < 0.03


@pytest.mark.parametrize(("kind", "aside"), slow_rest([("asymmetric", 7), ("circles", 5)]))
def test_a_circle_with_glare_is_not_seen_and_the_rest_is(kind, aside, photograph):
    photo = photograph(kind, 2000, 0.0)
    u, v = photo.pixels[20]
    image = cv2.circle(photo.image.copy(), (round(u) + aside, round(v) - aside), 7, 255, -1)
    seen = BOARDS[kind].find(image, 11)
    assert list(np.flatnonzero(~seen.seen)) == [20]
    assert np.nanmax(np.abs(seen.corners - photo.pixels)) < 0.1


@pytest.mark.parametrize("kind", slow_rest(["asymmetric", "circles"]))
@pytest.mark.parametrize("added", [False, True])
def test_light_that_falls_off_moves_no_circle(kind, added, photograph):
    """By a share of what is seen or added to it: it moved them by up to 0.4 px."""
    photo = photograph(kind, 2000, 0.0)
    across = np.linspace(-1.0, 1.0, photo.image.shape[1])
    across = across.reshape(-1, *(1,) * (photo.image.ndim - 2)) * np.ones(photo.image.shape)
    lit = 0.4 * photo.image + 85.0 + 60.0 * across if added else photo.image * (0.7 + 0.3 * across)
    seen = BOARDS[kind].find(np.clip(np.rint(lit), 0, 255).astype(np.uint8), 11)
    plain = BOARDS[kind].find(photo.image, 11)
    assert seen.seen.all()
    assert np.abs(seen.corners - plain.corners).max() < 0.08


def test_small_circles_are_found_and_smaller_ones_told_to_be(photograph):
    """Of less than 17 px all were said to lie at the image's edge, in glare, shadow or dirt."""
    photo = photograph("circles", 2000, 0.0)
    wide = CIRCLES._width_of(photo.pixels)
    for width, found in ((12.0, True), (6.5, False)):
        share = width / wide
        size = tuple(int(share * n) for n in photo.image.shape[1::-1])
        small = cv2.resize(photo.image, size, interpolation=cv2.INTER_AREA)
        seen = CIRCLES.find(small, 11)
        if found:
            scale = np.array(size) / photo.image.shape[1::-1]
            off = seen.corners - ((photo.pixels + 0.5) * scale - 0.5)
            assert np.abs(off).max() < 0.1
        else:
            assert "px wide, at least 9 px" in seen.reason


@pytest.mark.slow
@pytest.mark.parametrize(("columns", "seen"), [(2, True), (3, False)])
def test_a_grid_is_seen_while_a_quarter_of_it_is_lost_at_most(
    columns, seen, photograph, monkeypatch
):
    from nico_selfmodel.vision.boards import circle_grid

    photo = photograph("circles", 2001, 0.0)
    board, real = BOARDS["circles"], circle_grid._dark_centroid
    lost = board.find(photo.image, 11).corners.reshape(6, 8, 2)[:, :columns].reshape(-1, 2)

    def spoilt(gray, wide, outline):
        centre = real(gray, wide, outline)
        near = np.linalg.norm(lost - centre, axis=1).min() < 5.0
        return np.full(2, np.nan) if near else centre

    monkeypatch.setattr(circle_grid, "_dark_centroid", spoilt)
    found = board.find(photo.image, 11)
    if seen:
        assert np.count_nonzero(~found.seen) == 6 * columns
    else:
        assert "18 of its circles are not plain to see" in found.reason


@pytest.mark.parametrize("kind", slow_rest(["charuco", "april"]))
def test_what_a_card_hides_is_not_seen_and_the_rest_is(kind, photograph):
    photo = photograph(kind, 4, 0.5)
    seen = BOARDS[kind].find(photo.image, 11).seen
    assert not (seen & ~photo.free).any()
    assert np.mean(seen[photo.free]) > 0.6


@pytest.mark.slow
def test_boards_of_older_opencv_begin_with_a_tag():
    printed = printed_boards.charuco_print(8, 6, 0.03, 0.022, TAGS_5X5, legacy=True)
    board = board_of("charuco:7x5", 30, 22, "aruco_5x5_100")
    photo = printed_boards.photographed(printed, board.points, np.random.default_rng(3))
    seen = board.find(photo.image, 11)
    assert np.count_nonzero(seen.seen) >= 30
    assert np.nanmax(np.abs(seen.corners - photo.pixels)) < 0.3


@pytest.mark.slow
def test_tags_that_the_board_does_not_have_are_named(photograph):
    image = photograph("charuco", 2, 0.0).image
    small = board_of("charuco:3x3", 30, 22, "aruco_5x5_100").find(image, 11)
    assert isinstance(small, NotSeen)
    assert "which the stated board does not have" in small.reason
    assert "aruco_5x5_100" in small.reason
    other = board_of("charuco:8x6", 30, 22, "aruco_4x4_100").find(image, 11)
    assert other.reason.startswith("no aruco_4x4_100 tag")


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "further"), [("6x5", True), ("6x3", True), ("6x6", False)])
def test_a_board_of_fewer_rows_than_are_seen_is_another_one(stated, further, photograph):
    image = photograph("april", 4, 0.0).image
    found = board_of(f"aprilgrid:{stated}", 57.2, 44).find(image, 11)
    assert isinstance(found, OtherBoard) == further
    assert not further or f"beyond the {stated[-1]} rows of aprilgrid:{stated}" in found.reason


@pytest.mark.parametrize(("aside", "on"), [(0.48, True), (0.52, False)])
def test_a_tag_half_its_side_from_a_place_of_the_board_does_not_lie_on_it(aside, on):
    """A robot may wear tags of the board's family."""
    corners = 1e4 * APRIL.tag_corners
    last = np.arange(36)[:, None, None] == 35
    corners = corners + np.array([440.0 * aside, 0.0]) * last
    tags = TagsSeen("apriltag_36h11", tuple(range(36)), corners)
    assert lie_on(APRIL.tag_corners, tags, [35]) is on


@pytest.mark.parametrize(
    ("kind", "stated", "columns"),
    slow_rest(
        [
            ("charuco", "charuco:7x6", 8),
            ("charuco", "charuco:9x7", 8),
            ("april", "aprilgrid:5x6", 6),
        ]
    ),
)
def test_a_board_of_other_columns_is_named(kind, stated, columns, photograph):
    image = photograph(kind, 2, 0.3).image
    board = BOARDS[kind]
    sizes = (1e3 * board.square, 1e3 * board.tag, board.family)
    seen = board_of(stated, *sizes).find(image, 11)
    assert isinstance(seen, NotSeen)
    assert seen.reason.endswith(f"the tags lie as on a board of {columns} columns")


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("hidden", slow_rest([0.2, 0.5, 0.75]))
def test_a_grid_is_found_as_kalibr_prints_it_and_as_opencv_does(turned, hidden):
    """OpenCV has AprilTags half a turn on, but for its latest; its print is told by its tags."""
    printed = printed_boards.april_print(6, 6, 0.044, 0.3, TAGS_36H11, turned=turned)
    photo = printed_boards.photographed(
        printed, APRIL.points, np.random.default_rng(8), hidden=hidden
    )
    seen = APRIL.find(photo.image, 11)
    assert np.count_nonzero(seen.seen) > 0.35 * np.count_nonzero(photo.free)
    assert np.sqrt(np.nanmean((seen.corners - photo.pixels) ** 2)) < 0.03


@pytest.mark.parametrize("turned", [False, True])
def test_two_tags_tell_how_a_grid_was_printed_and_one_does_not(turned):
    printed = printed_boards.april_print(6, 6, 0.044, 0.3, TAGS_36H11, turned=turned)
    photo = printed_boards.photographed(printed, APRIL.points, np.random.default_rng(8))
    for tags in ((14,), (14, 15), (14, 22)):
        image = np.full_like(photo.image, 120)
        for tag in tags:
            own = photo.pixels[4 * tag : 4 * tag + 4]
            room = 0.4 * np.linalg.norm(own[0] - own[2])
            low, high = (own.min(axis=0) - room).astype(int), (own.max(axis=0) + room).astype(int)
            part = slice(low[1], high[1]), slice(low[0], high[0])
            image[part] = photo.image[part]
        seen = APRIL.find(image, 11)
        if len(tags) == 1:
            assert isinstance(seen, NotSeen)
            continue
        assert np.count_nonzero(seen.seen) >= 6
        assert np.nanmax(np.abs(seen.corners - photo.pixels)) < 0.1


def hint_of(stated, true, seen=lambda column: column >= 0):
    """Return what is told of columns where tags lie exactly as on another AprilGrid, some seen."""
    stated, true = board_of(f"aprilgrid:{stated}", 30, 22), board_of(f"aprilgrid:{true}", 30, 22)
    ids = np.flatnonzero(seen(np.arange(true.count) % true.columns))
    rng = np.random.default_rng(3)
    corners = 1e4 * true.tag_corners[ids] + rng.normal(0.0, 0.05, (len(ids), 4, 2))
    return stated._other_layout(TagsSeen(true.family, tuple(ids.tolist()), corners))


@pytest.mark.parametrize(
    ("stated", "true"),
    [("6x6", "12x3"), ("9x4", "12x3"), ("4x9", "12x3"), ("7x4", "6x3"), ("17x4", "15x4")],
)
def test_columns_that_are_one_more_or_less_are_told_apart_by_the_ends_of_rows(stated, true):
    assert hint_of(stated, true).endswith(f" of {true.split('x')[0]} columns")


def test_nothing_is_told_of_columns_where_several_numbers_fit_or_the_stated_one_does():
    assert hint_of("6x6", "12x3", lambda column: abs(column - 5.5) < 3.0) == ""
    assert hint_of("12x4", "12x3") == ""


@pytest.mark.slow
@pytest.mark.parametrize("tag", [40.0, 48.0])
def test_tags_of_another_size_are_named(tag, photograph):
    image = photograph("april", 3, 0.3).image
    seen = board_of("aprilgrid:6x6", 57.2, tag).find(image, 11)
    assert isinstance(seen, NotSeen)
    assert re.match(rf"the tags are 4[34]\.\d mm wide where --tag-mm says {tag}", seen.reason)


@pytest.mark.slow
@pytest.mark.parametrize("seed", slow_rest([5, 6, 9, 33], plain=1))
def test_a_fisheye_makes_no_tag_another_size(seed, prints):
    rng = np.random.default_rng(seed)
    fisheye = printed_boards.Lens((241.0,) * 2, (399.5, 299.5), (0.02, -0.01, 0.0, 0.0), True)
    pose = {"fill": rng.uniform(0.6, 0.95), "tilt": 0.7, "spread": np.radians(65), "lens": fisheye}
    photo = printed_boards.photographed(prints["april"], APRIL.points, rng, **pose)
    seen = APRIL.find(photo.image, 11)
    assert np.count_nonzero(seen.seen) > 20
    assert np.nanmax(np.abs(seen.corners - photo.pixels)) < 0.06


@pytest.mark.slow
def test_a_board_of_another_width_is_not_seen(photograph):
    image = photograph("charuco", 2, 0.0).image
    seen = board_of("charuco:6x8", 30, 22, "aruco_5x5_100").find(image, 11)
    assert isinstance(seen, NotSeen)


@pytest.mark.slow
def test_one_wrong_tag_leads_no_corner_astray(photograph, monkeypatch):
    from nico_selfmodel.vision.boards import april_grid

    photo = photograph("april", 5, 0.0)
    real = april_grid.seen_tags

    def misread(*args, **options):
        tags = real(*args, **options)
        corners = tags.corners.copy()
        corners[7], corners[20] = tags.corners[20], tags.corners[7]
        return type(tags)(tags.family, tags.ids, corners)

    monkeypatch.setattr(april_grid, "seen_tags", misread)
    seen = APRIL.find(photo.image, 11)
    # The others say where the misread ones are.
    assert seen.seen[[4 * 7, 4 * 20]].all()
    assert np.nanmax(np.abs(seen.corners - photo.pixels)) < 0.1


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("charoco:7x5", (), "no board 'charoco', did you mean 'charuco'"),
        ("charuco:7", (), "written as charuco:7x5"),
        ("charuco:7x5", (40.0,), "smaller than its squares"),
        ("charuco:30x30", (), "needs 480 tags, aruco_4x4_50 has 50"),
        ("aprilgrid:40x40", (), "needs 1600 tags"),
        ("aprilgrid:1x5", (), "at least 2x2"),
        ("aprilgrid:6x6", (20.0, "apriltag_9"), "no marker family 'apriltag_9'"),
        ("circles:2x5", (), "at least 3x3 circles"),
        ("circles:7x5", (40.0,), "smaller than their distance"),
        ("circles:7x5", (10.0, "aruco_4x4_50"), "--family is for boards with tags"),
        ("asymmetric-circles:4x10", (), "looks the same after half a turn"),
        ("9x6", (20.0,), "--tag-mm and --family are for"),
    ],
)
def test_boards_that_cannot_be_are_refused(text, more, message):
    with pytest.raises(ValueError, match=message):
        board_of(text, 30.0, *more)
