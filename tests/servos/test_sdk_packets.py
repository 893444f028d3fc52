"""The simulated servos' bytes against those of the makers' own packages, and of their manuals."""

from types import SimpleNamespace

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from nico_selfmodel.servos.dynamixel.simulated import packets as dynamixel
from nico_selfmodel.servos.feetech.simulated import packets as feetech

from .arms import virtual_arm

BYTES = st.binary(min_size=1, max_size=40)


class Wire:
    """A port as the packages want one: what is written is kept, what is read is given."""

    is_using = False

    def __init__(self, reply=b""):
        self.written, self.reply, self.late = b"", bytearray(reply), False

    def clearPort(self):
        pass

    def writePort(self, packet):
        self.written += bytes(packet)
        return len(packet)

    def readPort(self, length):
        data = bytes(self.reply[:length])
        del self.reply[:length]
        self.late = len(data) < length
        return data

    def setPacketTimeout(self, length):
        pass

    def isPacketTimeout(self):
        return self.late


def _dynamixel():
    sdk = pytest.importorskip("dynamixel_sdk")
    return SimpleNamespace(
        handler=sdk.PacketHandler(2.0),
        encode=dynamixel.encode,
        framing=dynamixel.DynamixelFraming(),
        word=lambda value: value.to_bytes(2, "little"),
        write_group=sdk.GroupSyncWrite,
        read_group=sdk.GroupSyncRead,
        receive=lambda handler, wire: handler.rxPacket(wire, False),
        data=lambda packet: bytes(packet[9 : packet[5] + (packet[6] << 8) + 5]),
        head=(4, 8),
    )


def _feetech():
    sdk = pytest.importorskip("scservo_sdk")
    return SimpleNamespace(
        handler=sdk.PacketHandler(0),
        encode=feetech.encode,
        framing=feetech.FeetechFraming(),
        word=lambda value: bytes((value,)),
        write_group=sdk.GroupSyncWrite,
        read_group=sdk.GroupSyncRead,
        receive=lambda handler, wire: handler.rxPacket(wire),
        data=lambda packet: bytes(packet[5:-1]),
        head=(2, 4),
    )


@pytest.fixture(params=[_dynamixel, _feetech], ids=["dynamixel", "feetech"])
def make(request):
    return request.param()


def test_packets_of_the_manuals_are_those_made_here():
    """Robotis e-Manual, Protocol 2.0: ping, read, write of servo 1; Feetech's manual likewise."""
    assert dynamixel.encode(1, 1, b"") == bytes.fromhex("FFFFFD00010300 01 194E")
    read = dynamixel.encode(1, 2, bytes.fromhex("84000400"))
    assert read == bytes.fromhex("FFFFFD0001070002840004001D15")
    write = dynamixel.encode(1, 3, bytes.fromhex("740000020000"))
    assert write == bytes.fromhex("FFFFFD0001090003740000020000CA89")
    status = dynamixel.encode(1, 0x55, bytes.fromhex("00060426"))
    assert status == bytes.fromhex("FFFFFD00010700550006042665 5D")
    assert feetech.encode(1, 1, b"") == bytes.fromhex("FFFF010201FB")
    assert feetech.encode(1, 2, bytes.fromhex("3802")) == bytes.fromhex("FFFF0104023802BE")


@given(address=st.integers(0, 252), register=st.integers(0, 147), data=BYTES)
def test_what_the_packages_send_is_what_the_servos_read(make_each, address, register, data):
    for make in make_each:
        handler, word = make.handler, make.word
        # The packages stuff a header into a copy that they then do not send; no register of ours
        # can hold one.
        assume(b"\xff\xff\xfd" not in word(register) + data)
        sent = {
            1: lambda wire, h=handler: h.ping(wire, address),
            2: lambda wire, h=handler: h.readTx(wire, address, register, len(data)),
            3: lambda wire, h=handler: h.writeTxOnly(
                wire, address, register, len(data), list(data)
            ),
        }
        parameters = {1: b"", 2: word(register) + word(len(data)), 3: word(register) + data}
        for code, send in sent.items():
            wire = Wire()
            send(wire)
            assert wire.written == make.encode(address, code, parameters[code])
            heard = bytearray(b"\x55\xff" + wire.written)
            packet = make.framing.take(heard)
            assert (packet.address, packet.code, packet.parameters) == (
                address,
                code,
                parameters[code],
            )
            assert not heard


@given(address=st.integers(0, 252), error=st.integers(0, 0x7F), data=BYTES)
def test_what_the_servos_answer_is_what_the_packages_read(make_each, address, error, data):
    for make in make_each:
        packet, result = make.receive(make.handler, Wire(make.framing.answer(address, error, data)))
        assert result == 0
        assert [packet[k] for k in make.head] == [address, error]
        assert make.data(packet) == data


@pytest.fixture(scope="module")
def make_each():
    return [_dynamixel(), _feetech()]


@pytest.mark.parametrize("name", ["dynamixel", "feetech"])
def test_the_driver_sends_and_asks_for_six_servos_with_the_packages_own_group_packets(name):
    make = _dynamixel() if name == "dynamixel" else _feetech()
    made = virtual_arm(make=name)
    made.arm.connect()
    made.arm.enable()
    written = []
    original = made.port.write
    made.port.write = lambda data: (written.append(bytes(data)), original(data))[0]
    made.arm.move({"right_elbow": 0.5, "right_wrist": -0.5})
    goals, _ = written[-1], written.clear()
    made.arm.cycle()
    motors = made.arm.bus.motors
    register, (first, length) = motors[0].goal_register, motors[0].block
    wire = Wire()
    group = make.write_group(wire, make.handler, register, len(motors[0].encode(motors[0].told)))
    for motor in motors:
        group.addParam(motor.address, list(motor.encode(motor.told)))
    group.txPacket()
    assert goals == wire.written
    wire = Wire()
    group = make.read_group(wire, make.handler, first, length)
    for motor in motors:
        group.addParam(motor.address)
    group.txPacket()
    assert written[0] == wire.written


def test_a_header_among_the_data_of_an_answer_is_stuffed_and_taken_out_again():
    make = _dynamixel()
    data = b"\x01\xff\xff\xfd\x02\xff\xff\xfd"
    answer = make.framing.answer(7, 0, data)
    assert len(answer) == 11 + len(data) + 2
    packet, result = make.receive(make.handler, Wire(answer))
    assert result == 0
    assert make.data(packet) == data


@pytest.mark.parametrize("spoil", [1, 0x80])
def test_damage_is_noticed_wherever_it_is(make, spoil):
    whole = make.encode(3, 2, make.word(132) + make.word(4))
    for k in range(len(whole)):
        heard = bytearray(whole)
        heard[k] ^= spoil
        assert make.framing.take(heard) is None
    for k in set(range(len(whole))) - set(range(make.head[0], make.head[0] + 3)):  # length
        heard = bytearray(whole[:k] + whole[k + 1 :] + whole)
        packet = make.framing.take(heard)  # the next packet is heard all the same
        assert packet is not None
        assert packet.address == 3
