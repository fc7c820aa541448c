"""MicroStrain MIP: printed packets of the manuals, the two roles against each other, damaged streams, and the vendor's own client."""

from __future__ import annotations

import os
import pty
import struct
import subprocess
import sys
import time
import tty
from math import cos, isfinite, nan, sin
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spsp_ctrl.devices import mip_device, mip_host
from spsp_ctrl.devices import mip_table as T
from spsp_ctrl.devices.mip_device import ImuState, MipImu
from spsp_ctrl.devices.mip_host import ImuDecoder, ImuReading, Packet, PacketParser, SetUp

STATE = ImuState(0.1, -0.2, 0.3, 0.01, 0.02, -0.03)

# 3DM-GX5-35 and 3DM-GX5-45 data communications manuals, as printed
PRINTED_COMMANDS = {
    "7565 0102 0201 E0C6": mip_host.ping(),
    "7565 0102 0202 E1C7": mip_host.set_idle(),
    "7565 0102 0203 E2C8": mip_host.device_info(),
    "7565 0102 0206 E5CB": mip_host.resume(),
    "7565 0102 0204 E3C9": mip_host.command(T.BASE, T.DESCRIPTORS),
    "7565 0C02 0206 F0F7": mip_host.command(T.CMD_3DM, T.SENSOR_RATE),
    "7565 0C05 0511 0101 0104 1A": mip_host.command(T.CMD_3DM, T.STREAM, bytes((T.WRITE, T.STREAM_SELECTOR[T.SENSOR], 1))),
    "7565 0C05 0511 0101 0003 19": mip_host.command(T.CMD_3DM, T.STREAM, bytes((T.WRITE, T.STREAM_SELECTOR[T.SENSOR], 0))),
}
PRINTED_ANSWERS = {
    "7565 0104 04F1 0100 D56A": (T.BASE, mip_host.ping()),
    "7565 0104 04F1 0600 DA74": (T.BASE, mip_host.resume()),
    "7565 0C08 04F1 0600 0483 0064 D46B": (T.CMD_3DM, mip_host.command(T.CMD_3DM, T.SENSOR_RATE)),
}
ACCELEROMETER = bytes.fromhex("7565 800E 0E04 3E7A63A0 BB8E3B29 7FE5BF7F 84EE")


@pytest.mark.parametrize(("printed", "ours"), PRINTED_COMMANDS.items())
def test_commands_are_the_printed_ones(printed: str, ours: bytes) -> None:
    assert ours == bytes.fromhex(printed)


@pytest.mark.parametrize(("printed", "asked"), PRINTED_ANSWERS.items())
def test_answers_are_the_printed_ones(printed: str, asked: tuple[int, bytes]) -> None:
    answer = bytes.fromhex(printed)
    assert MipImu(base_rate_hz=100).receive(asked[1]) == answer
    (packet,) = PacketParser().feed(answer)
    assert packet.descriptor_set == asked[0]
    assert mip_host.acknowledged(packet) == (asked[1][5], T.ACK_OK)


def test_the_printed_data_packet() -> None:
    (packet,) = PacketParser().feed(ACCELEROMETER)
    data = packet.field(T.ACCEL)
    assert data is not None
    assert struct.unpack(T.VECTOR, data)[:2] == pytest.approx((0.24452066, -0.00434055), rel=1e-5)  # z is printed as a NaN
    assert mip_device.fletcher(ACCELEROMETER[:-2]) == 0x84EE
    assert mip_host.checksum(ACCELEROMETER[:-2]) == b"\x84\xee"


@given(st.binary(max_size=300))
def test_both_checksums_agree(data: bytes) -> None:
    assert mip_host.checksum(data) == mip_device.fletcher(data).to_bytes(2, "big")


def set_up(imu: MipImu, rate_hz: int = 250) -> tuple[SetUp, PacketParser]:
    dialogue, parser = SetUp(rate_hz), PacketParser()
    packets: list[Packet] = []
    for k in range(20):
        out = dialogue.step(k * 1_000_000, packets)
        packets = parser.feed(imu.receive(out))
        if dialogue.done:
            break
    return dialogue, parser


def test_host_sets_the_device_up_and_reads_what_it_senses() -> None:
    imu = MipImu(500)
    dialogue, parser = set_up(imu)
    assert dialogue.done, dialogue.problem
    assert dialogue.info is not None
    assert dialogue.info[:] == ("1.1.05", "3DM-CV7-AHRS", "6286-9905", "6286.000001")
    assert dialogue.rate_hz == 250.0
    decoder = ImuDecoder()
    found = [r for k in range(10) for r in decoder.decode(parser.feed(imu.sample(2_000_000 * k, STATE)))]
    assert [r.device_ns for r in found] == [4_000_000 * k for k in range(5)]
    assert all(r.valid for r in found)
    assert found[0][2:] == pytest.approx(STATE[:6], abs=1e-7)


def test_sensor_set_gives_the_rate_when_the_filter_does_not() -> None:
    imu, parser, decoder = MipImu(100), PacketParser(), ImuDecoder()
    for data_set, fields in ((T.SENSOR, ((T.ACCEL, 1), (T.GYRO, 1), (T.REFERENCE_TIME, 1))), (T.FILTER, ((T.EULER, 2),))):
        imu.receive(mip_host.message_format(data_set, fields) + mip_host.stream(data_set, True))
    found = decoder.decode(parser.feed(b"".join(imu.sample(k, STATE) for k in range(4))))
    assert len(found) == 2
    assert found[0] == ImuReading(-1, True, *(struct.unpack(">f", struct.pack(">f", v))[0] for v in STATE[:6]))
    assert ImuDecoder().decode([Packet(T.FILTER, ((T.EULER, struct.pack(T.FLAGGED_VECTOR, 0, 0, 0, 1)),))]) == []


@given(st.integers(0, 3000 * T.WEEK_NS))
def test_a_unit_without_reference_time_is_stamped_by_gps_time(time_ns: int) -> None:
    imu = MipImu(500)
    imu.receive(mip_host.message_format(T.FILTER, ((T.FILTER_GPS_TIME, 1), (T.EULER, 1), (T.ANGULAR_RATE, 1))) + mip_host.stream(T.FILTER, True))
    (reading,) = ImuDecoder().decode(PacketParser().feed(imu.sample(time_ns, STATE)))
    assert abs(reading.device_ns - time_ns) <= 1


def test_idle_is_silent_and_resume_goes_on() -> None:
    imu = MipImu(500)
    set_up(imu, 500)
    assert imu.sample(0, STATE)
    imu.receive(mip_host.set_idle())
    assert imu.sample(1, STATE) == b""
    imu.receive(mip_host.resume())
    assert imu.sample(2, STATE)


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        (mip_host.command(T.BASE, 0x70), T.NACK_UNKNOWN),
        (mip_host.command(0x0D, 0x01), T.NACK_UNKNOWN),
        (mip_host.base_rate(0x91), T.NACK_PARAMETER),
        (mip_host.message_format(T.FILTER, ((0x01, 1),)), T.NACK_PARAMETER),
        (mip_host.message_format(T.FILTER, ((T.EULER, 0),)), T.NACK_PARAMETER),
        (mip_host.message_format(T.FILTER, ((T.EULER, 1),) * 16), T.NACK_PARAMETER),
        (mip_host.command(T.CMD_3DM, T.MESSAGE_FORMAT, bytes((T.WRITE, T.FILTER, 2, T.EULER, 0, 1))), T.NACK_PARAMETER),
        (mip_host.command(T.CMD_3DM, T.STREAM, bytes((T.WRITE, T.FILTER, 2))), T.NACK_PARAMETER),
        (mip_host.command(T.CMD_3DM, T.STREAM, b""), T.NACK_PARAMETER),
    ],
)
def test_the_device_refuses_what_it_cannot_do(sent: bytes, code: int) -> None:
    (packet,) = PacketParser().feed(MipImu().receive(sent))
    assert mip_host.acknowledged(packet) == (sent[5], code)


def test_dialogue_says_what_went_wrong() -> None:
    silent = SetUp(250)
    for k in range(10):
        silent.step(k * SetUp.TIMEOUT_NS, [])
    assert silent.problem == "the IMU does not answer command 0x02 of set 0x01"
    refused = SetUp(250)
    refused.step(0, [])
    refused.step(1, PacketParser().feed(mip_device.packet(T.BASE, (T.REPLY, bytes((T.SET_IDLE, T.NACK_FAILED))))))
    assert refused.problem == "the IMU refuses command 0x02 of set 0x01: command failed (4)"


def stream(count: int) -> list[bytes]:
    imu = MipImu(500)
    set_up(imu, 500)
    return [imu.sample(2_000_000 * k, STATE._replace(yaw_rad=k / 8)) for k in range(count)]


PACKETS = stream(12)
SIZE = len(PACKETS[0])


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_a_damaged_packet_costs_itself_only(data: st.DataObject) -> None:
    """Any bytes of one packet changed, removed or put in: no packet that was not sent appears, all the others do."""
    victim = data.draw(st.integers(0, 7))
    kind = data.draw(st.sampled_from(["change", "cut", "insert"]))
    at = data.draw(st.integers(0, SIZE - 1))
    spoiled = bytearray(PACKETS[victim])
    if kind == "change":
        for place in range(at, min(SIZE, at + data.draw(st.integers(1, 6)))):
            spoiled[place] ^= data.draw(st.integers(1, 255))
    elif kind == "cut":
        del spoiled[at : at + data.draw(st.integers(1, SIZE))]
    else:
        spoiled[at:at] = data.draw(st.binary(min_size=1, max_size=40))
    whole = b"".join(bytes(spoiled) if k == victim else p for k, p in enumerate(PACKETS)) + bytes(T.MAX_PACKET_BYTES)
    parser, decoder, found = PacketParser(), ImuDecoder(), []
    cut = data.draw(st.integers(1, 97))
    for start in range(0, len(whole), cut):
        found += decoder.decode(parser.feed(whole[start : start + cut]))
    times = [r.device_ns // 2_000_000 for r in found]
    assert set(times) >= set(range(12)) - {victim}, "a good packet was lost"
    assert len(times) <= 12
    for k, reading in zip(times, found, strict=True):
        assert reading.yaw_rad == k / 8
        assert reading[2:4] == pytest.approx(STATE[:2], abs=1e-7)


@given(st.integers(0, SIZE - 1), st.integers(1, 255))
def test_one_changed_byte_never_gives_a_reading(at: int, flip: int) -> None:
    """A single wrong byte is always seen by the checksum (or by the lengths)."""
    spoiled = bytearray(PACKETS[3])
    spoiled[at] ^= flip
    parser = PacketParser()
    assert ImuDecoder().decode(parser.feed(bytes(spoiled) + bytes(T.MAX_PACKET_BYTES))) == []
    assert parser.bad_packets or at < 2


@given(st.lists(st.one_of(st.binary(max_size=60), st.just(T.SYNC), st.just(PACKETS[0]), st.just(mip_host.device_info())), max_size=30))
@settings(max_examples=200, deadline=None)
def test_no_bytes_raise_on_either_side(pieces: list[bytes]) -> None:
    parser, decoder, imu, dialogue = PacketParser(), ImuDecoder(), MipImu(), SetUp(100)
    for k, piece in enumerate(pieces):
        packets = parser.feed(piece)
        decoder.decode(packets)
        dialogue.step(k * 10**8, packets)
        imu.receive(piece)
        parser.feed(imu.sample(k, STATE))


@given(
    st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=80)), min_size=1, max_size=3),
    st.sampled_from([T.BASE, T.CMD_3DM, T.SENSOR, T.FILTER]),
)
@settings(max_examples=300, deadline=None)
def test_no_well_formed_packet_raises(fields: list[tuple[int, bytes]], data_set: int) -> None:
    """Right checksum, any content: fields of wrong length give no reading, commands of any length an answer."""
    body = mip_device.packet(data_set, *fields)
    decoder = ImuDecoder()
    for reading in decoder.decode(PacketParser().feed(body)):
        assert not reading.valid or all(map(isfinite, reading[2:]))
    MipImu().receive(body)


def test_nan_is_not_valid() -> None:
    imu = MipImu(500)
    _, parser = set_up(imu, 500)
    (reading,) = ImuDecoder().decode(parser.feed(imu.sample(0, STATE._replace(roll_rad=nan))))
    assert not reading.valid
    (reading,) = ImuDecoder().decode(parser.feed(imu.sample(0, STATE._replace(valid=False))))
    assert not reading.valid


@pytest.mark.peers
def test_the_vendors_client_opens_our_imu_and_receives_data() -> None:
    """pymscl over a pseudo-terminal: finds, configures and streams the filter set of the simulated unit."""
    mscl = pytest.importorskip("mscl", reason="pymscl (the vendor's client) has no wheel here")
    master, slave = pty.openpty()
    tty.setraw(master)
    tty.setraw(slave)
    script = Path(__file__).with_name("mip_on_pty.py")
    device = subprocess.Popen([sys.executable, str(script), str(master), "30"], pass_fds=[master])
    try:
        node = mscl.InertialNode(mscl.Connection.Serial(os.ttyname(slave), 115200))
        node.timeout(3000)
        assert node.ping()
        assert (node.modelName(), node.modelNumber(), node.serialNumber()) == ("3DM-CV7-AHRS", "6286-9905", "6286.000001")
        kinds = mscl.MipTypes
        node.setToIdle()
        assert node.getDataRateBase(kinds.CLASS_ESTFILTER) == 500
        channels = mscl.MipChannels()
        euler, rate = kinds.CH_FIELD_ESTFILTER_ESTIMATED_ORIENT_EULER, kinds.CH_FIELD_ESTFILTER_ESTIMATED_ANGULAR_RATE
        fields = (T.FILTER << 8 | T.REFERENCE_TIME, euler, rate)
        for field in fields:
            channels.append(mscl.MipChannel(field, mscl.SampleRate.Hertz(250)))
        node.setActiveChannelFields(kinds.CLASS_ESTFILTER, channels)
        active = node.getActiveChannelFields(kinds.CLASS_ESTFILTER)
        assert {c.channelField(): c.sampleRate().samples() for c in active} == dict.fromkeys(fields, 250)
        sensors = mscl.MipChannels()
        for field in (T.SENSOR << 8 | T.REFERENCE_TIME, kinds.CH_FIELD_SENSOR_SCALED_ACCEL_VEC, kinds.CH_FIELD_SENSOR_SCALED_GYRO_VEC):
            sensors.append(mscl.MipChannel(field, mscl.SampleRate.Hertz(500)))
        node.setActiveChannelFields(kinds.CLASS_AHRS_IMU, sensors)
        node.enableDataStream(kinds.CLASS_AHRS_IMU)
        node.enableDataStream(kinds.CLASS_ESTFILTER)
        node.resume()
        counts = {T.SENSOR: 0, T.FILTER: 0}
        end = time.monotonic() + 10
        while min(counts.values()) < 50 and time.monotonic() < end:
            for packet in node.getDataPackets(200):
                counts[packet.descriptorSet()] += 1
                points = {p.channelName(): p for p in packet.data()}
                assert all(p.valid() for p in points.values())
                (stamp,) = (p for name, p in points.items() if "referenceTime" in name)
                t = stamp.as_uint64() * 1e-9
                if packet.descriptorSet() == T.FILTER:
                    expected = {"estRoll": 0.1 * sin(t), "estPitch": 0.2 * cos(t), "estAngularRateX": 0.1 * cos(t), "estAngularRateY": -0.2 * sin(t)}
                else:
                    expected = {"scaledGyroX": 0.1 * cos(t), "scaledGyroY": -0.2 * sin(t), "scaledGyroZ": 0.01, "scaledAccelZ": -1.0}
                assert {name: points[name].as_float() for name in expected} == pytest.approx(expected, abs=1e-6)
        assert min(counts.values()) >= 50
    finally:
        device.kill()
        device.wait()
        os.close(master)
        os.close(slave)
