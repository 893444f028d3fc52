"""The hand: timed motions, a current cut-off, and our line protocol."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.hand import Hand, decode_line, encode_line
from nico_selfmodel.servos.simulated.hand import HandFirmware
from nico_selfmodel.servos.simulated.port import SimulatedPort


@pytest.fixture
def board():
    return HandFirmware()


@pytest.fixture
def hand(board):
    return Hand(SimulatedPort(board, 9600))


def test_a_stop_that_is_refused_hides_nothing_of_why_it_was_sent(hand, board, monkeypatch):
    obey = board._obey

    def busy(words, now):
        if words[0] == "STATE":
            raise KeyboardInterrupt
        return "ERR busy" if words[0] == "STOP" else obey(words, now)

    monkeypatch.setattr(board, "_obey", busy)
    with pytest.raises(KeyboardInterrupt):
        hand.move("close", seconds=0.2)


def test_a_hand_says_that_it_is_one(hand):
    assert hand.identify() == "hand 1"
    assert hand.position == {"index": "unknown", "fingers": "unknown"}


@pytest.mark.parametrize(
    ("way", "place", "word"), [("open", 0.0, "open"), ("close", 1.0, "closed")]
)
def test_fingers_run_to_their_stop_and_the_current_cuts_them_off(hand, board, way, place, word):
    begin = hand.port.time
    assert hand.move(way, seconds=3.0) == {"index": "current", "fingers": "current"}
    assert hand.port.time - begin < 1.5
    assert [finger.place for finger in board.fingers.values()] == [place, place]
    assert hand.position == {"index": word, "fingers": word}


def test_time_ends_a_motion_too(hand, board):
    begin = hand.port.time
    assert hand.move("close", ["index"], seconds=0.2, power=0.5) == {"index": "time"}
    assert hand.port.time - begin == pytest.approx(0.3, abs=0.15)
    assert 0.5 < board.fingers["index"].place < 1.0
    assert board.fingers["fingers"].place == 0.5
    assert hand.position["fingers"] == "unknown"


def test_something_in_the_hand_stops_the_fingers_around_it(hand, board):
    board.fingers["fingers"].obstacle = 0.7
    assert hand.move("close", seconds=3.0)["fingers"] == "current"
    assert board.fingers["fingers"].place == 0.7


def test_a_host_that_dies_leaves_a_hand_that_stops(hand, board):
    hand.ask("LIMIT index 1023")
    hand.ask("GO index close 255 60000")
    hand.port.sleep(6.0)
    board.due(hand.port.time)
    assert (board.fingers["index"].motion, board.fingers["index"].cause) == ("idle", "time")


def test_a_motor_that_was_stopped_from_elsewhere_is_where_nobody_knows(hand, board):
    original = board._obey

    def stop_at_once(words, now):
        answer = original(words, now)
        if words[0] == "GO":
            board.fingers[words[1]].halt("stop")
        return answer

    board._obey = stop_at_once
    with pytest.raises(ServoFault, match="index was stopped by 'stop'"):
        hand.move("open", ["index"])
    assert hand.position["index"] == "unknown"


def test_a_motor_that_never_ends_is_a_fault(hand, board):
    board.fingers["index"].advance = lambda now: None
    with pytest.raises(ServoFault, match="does not stop in time"):
        hand.move("open", ["index"], seconds=0.5)
    assert board.fingers["index"].cause == "stop"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("wave",), "open, close"),
        (("open", ["thumb"]), "index, fingers"),
        (("open", []), "index, fingers"),
    ],
)
def test_a_motion_that_the_hand_cannot_make_is_refused(hand, arguments, words):
    with pytest.raises(ValueError, match=words):
        hand.move(*arguments)


@pytest.mark.parametrize(
    "options",
    [
        {"seconds": 0.0},
        {"seconds": float("nan")},
        {"seconds": 9.0},
        {"power": 0.0},
        {"power": 1.1},
        {"current_limit": 2000},
    ],
)
def test_numbers_out_of_range_are_refused(hand, board, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        hand.move("open", **options)
    assert board.fingers["index"].cause == "none"


def test_a_damaged_line_is_sent_again(hand, board):
    original, damaged = board.receive, []

    def damage(data, now, rate):
        if not damaged:
            damaged.append(data)
            data = data.replace(b"ID", b"IX")
        original(data, now, rate)

    board.receive = damage
    assert hand.identify() == "hand 1"
    assert damaged == [b"ID*0D\n"]


def test_silence_and_strangers_are_no_hand(hand, board):
    board._obey = lambda words, now: "ID toaster"
    with pytest.raises(BusError, match="is no hand: it says 'ID toaster'"):
        hand.identify()
    with pytest.raises(BusError, match="state cannot be read"):
        hand.state()
    with pytest.raises(ServoFault, match="refuses 'STOP'"):
        hand.stop()
    board.receive = lambda *_: None
    with pytest.raises(BusError, match="no hand answers"):
        hand.identify()


def test_a_word_that_the_board_does_not_know_is_an_error(hand):
    assert hand.ask("DANCE") == "ERR command"
    assert hand.ask("GO thumb open 10 10") == "ERR command"
    assert hand.ask("LIMIT index lots") == "ERR command"


def test_lines_carry_their_checksum():
    assert encode_line("ID") == b"ID*0D\n"
    assert decode_line(b"ID*0D\n") == "ID"


@given(st.binary(max_size=40))
def test_any_bytes_are_a_line_or_an_error(data):
    try:
        body = decode_line(data)
    except BusError:
        return
    assert encode_line(body) == data


@given(st.text(st.characters(codec="ascii", exclude_characters="*\n"), max_size=30), st.data())
def test_one_changed_byte_of_a_line_never_goes_unnoticed(body, data):
    line = bytearray(encode_line(body))
    place = data.draw(st.integers(0, len(line) - 1))
    line[place] ^= data.draw(st.integers(1, 255))
    with pytest.raises(BusError):
        decode_line(bytes(line))
