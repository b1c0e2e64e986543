"""Recorded telemetry: cut ends, garbage, wrong stamps and two vehicles."""

from pathlib import Path

import pytest
from examples import examples
from flight_copy import FLIGHTS
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.errors import DriverError
from drivers.files.tlog import GARBAGE, read_tlog, records
from drivers.files.tlog_survey import survey_tlog
from drivers.mavlink.telemetry import TelemetryDecoder
from drivers.samples import Attitude, Refusal

START_US = 1_700_000_000_000_000


def packet(k, *, version=2, system=1, stamp_us=None):
    """One stamped ATTITUDE, 10 ms after the one before."""
    message = mavlink.MAVLink_attitude_message(5000 + 10 * k, 0.01 * k, 0, 0, 0, 0, 1)
    packer = mavlink.MAVLink(None, system, 1)
    stamp_us = START_US + 10_000 * k if stamp_us is None else stamp_us
    return stamp_us.to_bytes(8, "big") + message.pack(packer, force_mavlink1=version == 1)


def read(tmp_path, data):
    path = tmp_path / "vehicle.tlog"
    path.write_bytes(data)
    return list(read_tlog(path, TelemetryDecoder()))


def attitudes(samples):
    return [round(s.roll * 100) for s in samples if isinstance(s, Attitude)]


def refusals(samples):
    return [s.reason for s in samples if isinstance(s, Refusal)]


@pytest.mark.parametrize("version", [1, 2])
def test_both_versions_of_the_protocol(tmp_path, version):
    samples = read(tmp_path, b"".join(packet(k, version=version) for k in range(20)))
    assert attitudes(samples) == list(range(20))
    assert samples[3].arrival_us == START_US + 30_000


def test_signed_packets_are_read(tmp_path):
    packer = mavlink.MAVLink(None, 1, 1)
    packer.signing.sign_outgoing = True
    packer.signing.secret_key = bytes(32)
    packed = [
        mavlink.MAVLink_attitude_message(5000 + k, 0.01 * k, 0, 0, 0, 0, 1).pack(packer) for k in range(5)
    ]
    data = b"".join((START_US + k).to_bytes(8, "big") + p for k, p in enumerate(packed))
    assert attitudes(read(tmp_path, data)) == list(range(5))


@given(st.integers(0, 400))
@examples(60)
def test_a_cut_end_costs_only_the_last_packet(cut):
    data = b"".join(packet(k) for k in range(10))
    kept = data[: len(data) - cut]
    found = list(records(kept))
    whole = [r for r in found if r.message_id != GARBAGE]
    size = len(data) // 10
    assert len(whole) == len(kept) // size
    assert sum(r.end - r.start for r in found) == len(kept)


@given(st.binary(min_size=1, max_size=300), st.integers(1, 18))
@examples(150)
def test_garbage_between_packets_costs_at_most_a_neighbour(noise, at):
    before, after = b"".join(packet(k) for k in range(at)), b"".join(packet(k) for k in range(at, 20))
    found = list(records(before + noise + after))
    assert sum(r.end - r.start for r in found) == len(before) + len(noise) + len(after)
    intact = {r.start for r in found if r.message_id == 30}
    size = len(before) // at
    expected = {k * size for k in range(at - 1)} | {
        len(before) + len(noise) + k * size for k in range(1, 20 - at)
    }
    assert expected <= intact


def test_garbage_is_counted_with_its_place(tmp_path):
    data = b"".join(packet(k) for k in range(10))
    size = len(data) // 10
    samples = read(tmp_path, data[: 5 * size] + b"\x00\xfd\xfe\x01" * 50 + data[5 * size :])
    assert attitudes(samples) == list(range(10))
    assert refusals(samples) == ["garbage"]
    assert "200 bytes" in next(s for s in samples if isinstance(s, Refusal)).detail


def test_a_flipped_bit_is_a_bad_checksum(tmp_path):
    data = bytearray(b"".join(packet(k) for k in range(10)))
    data[4 * (len(data) // 10) + 25] ^= 0x10
    samples = read(tmp_path, bytes(data))
    assert attitudes(samples) == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert refusals(samples) == ["bad_checksum"]


def test_a_single_wrong_stamp_is_no_jump(tmp_path):
    packets = [packet(k) for k in range(10)]
    packets[4] = packet(4, stamp_us=START_US + 3_600_000_000)
    samples = read(tmp_path, b"".join(packets))
    assert attitudes(samples) == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert refusals(samples) == ["garbage"]
    assert max(s.arrival_us for s in samples) < START_US + 1_000_000


def test_an_empty_file_is_one_refusal(tmp_path):
    assert refusals(read(tmp_path, b"")) == ["empty_file"]


@given(st.binary(max_size=2000))
@examples(60)
def test_any_bytes_are_read_to_their_end(noise):
    assert sum(r.end - r.start for r in records(noise)) == len(noise)


def test_a_megabyte_of_markers_does_not_hang(tmp_path):
    samples = read(tmp_path, b"\xfe" * 300_000)
    assert refusals(samples) == ["cut_off"]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DriverError, match=r"no\.tlog"):
        list(read_tlog(tmp_path / "no.tlog", TelemetryDecoder()))


def test_survey_finds_the_vehicles(tmp_path):
    path = tmp_path / "two.tlog"
    path.write_bytes(b"".join(packet(k, system=1 + 6 * (k % 2)) for k in range(40)))
    assert survey_tlog(path).vehicles == (1, 7)


@pytest.mark.parametrize("seconds", [-30.0, -0.8, 0.8, 30.0])
def test_survey_finds_where_the_clock_was_set(tmp_path, seconds):
    by_us = round(seconds * 1e6)
    stamps = [START_US + 10_000 * k + (by_us if k >= 100 else 0) for k in range(200)]
    path = tmp_path / "set.tlog"
    path.write_bytes(b"".join(packet(k, stamp_us=t) for k, t in enumerate(stamps)))
    (step,) = survey_tlog(path).steps
    assert (step.before_us, step.after_us) == (stamps[99], stamps[100])
    assert step.size_us == pytest.approx(by_us, abs=1000)


def test_survey_takes_a_stalled_link_for_no_step(tmp_path):
    """Messages 100 to 160 all arrive at once, with 0.9 s of delay for the first of them."""
    stamps = [START_US + 10_000 * (190 if 100 <= k < 190 else k) for k in range(400)]
    path = tmp_path / "stalled.tlog"
    path.write_bytes(b"".join(packet(k, stamp_us=t) for k, t in enumerate(stamps)))
    assert survey_tlog(path).steps == ()


def test_recorded_flights_are_read_whole():
    for flight in sorted(path for path in FLIGHTS.iterdir() if path.is_dir()):
        path: Path = flight / "vehicle.tlog"
        survey = survey_tlog(path)
        assert survey.vehicles == (1,)
        assert survey.steps == ()
        samples = list(read_tlog(path, TelemetryDecoder()))
        assert refusals(samples) == []
        seconds = (survey.last_us - survey.first_us) * 1e-6
        assert sum(isinstance(s, Attitude) for s in samples) == pytest.approx(100 * seconds, rel=0.01)
