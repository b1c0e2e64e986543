"""Frames out of byte streams: nothing is lost, whatever lies between them; and what leaves is numbered and signed."""

from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import FrameSplitter, Garbage, WireFrame
from drivers.mavlink.outgoing import Sealer
from drivers.mavlink.signing import Signer, unsigned

KEY = bytes(range(32))


def frame(number: int, version1: bool = False, signed: bool = False) -> bytes:
    mav = dialect.MAVLink(None, 1, 1)
    mav.seq = number % 256
    data = bytes(
        dialect.MAVLink_attitude_message(number, 0.1, 0.2, 0.3, 0, 0, 0.5).pack(mav, force_mavlink1=version1)
    )
    return Signer(KEY, now=lambda: 10**12 + number).sign(data) if signed else data


FRAMES = st.builds(frame, st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
JUNK = st.binary(min_size=1, max_size=30).filter(lambda b: 0xFE not in b and 0xFD not in b)


def fed(data: bytes, chunks: list[int]) -> list[WireFrame | Garbage]:
    splitter, pieces, at = FrameSplitter(), [], 0
    for length in [*chunks, len(data)]:
        pieces += splitter.feed(data[at : at + length])
        at += length
    return pieces


@given(st.lists(st.one_of(FRAMES, JUNK), max_size=12), st.lists(st.integers(1, 40), max_size=20))
def test_every_frame_and_every_byte_comes_out_in_order(parts, chunks) -> None:
    data = b"".join(parts)
    pieces = fed(data, chunks)
    assert b"".join(piece.data for piece in pieces) == data
    assert [p.data for p in pieces if isinstance(p, WireFrame)] == [p for p in parts if p[0] in (0xFD, 0xFE)]


@given(st.binary(max_size=400), st.lists(FRAMES, min_size=8, max_size=8))
def test_frames_behind_any_garbage_are_found(junk, frames) -> None:
    # Up to 280 bytes behind a stray marker wait for their frame to end; then all of them are looked at again.
    pieces = fed(junk + b"".join(frames) + frame(7) * 10, [])
    assert set(frames[4:]) <= {p.data for p in pieces if isinstance(p, WireFrame)}


@given(st.binary(max_size=2000))
def test_nothing_raises_and_nothing_appears(data) -> None:
    out = b"".join(piece.data for piece in fed(data, [7, 11, 13]))
    assert data.startswith(out)
    assert len(data) - len(out) <= 280


@given(st.integers(0, 2**32 - 1), st.integers(0, 200))
def test_any_changed_byte_breaks_the_signature(number, position) -> None:
    signed = frame(number, signed=True)
    (piece,) = FrameSplitter().feed(signed)
    assert isinstance(piece, WireFrame)
    assert Signer(KEY, now=lambda: 0).refusal(piece) is None
    changed = bytearray(signed)
    changed[12 + position % (len(signed) - 12)] ^= 1
    for other in FrameSplitter().feed(bytes(changed)):
        assert isinstance(other, Garbage) or Signer(KEY, now=lambda: 0).refusal(other) is not None


def test_taking_the_signature_off_gives_the_frame_back() -> None:
    assert unsigned(frame(5, signed=True)) == frame(5)
    assert unsigned(frame(5)) == frame(5)
    assert unsigned(frame(5, version1=True)) == frame(5, version1=True)


def test_two_senders_of_one_component_count_together() -> None:
    sealer = Sealer(191, None)
    foreign = dialect.MAVLink(None, 1, 191)
    foreign.seq = 77
    sent = []
    for i in range(300):
        if i % 3:
            sent.append(sealer.pack(dialect.MAVLink_timesync_message(0, i), 1))
        else:
            beat = bytes(dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(foreign))
            sent += [sealed for _, sealed in sealer.take_over(beat)]
    pieces = FrameSplitter().feed(b"".join(sent))
    assert [p.sequence for p in pieces if isinstance(p, WireFrame)] == [i % 256 for i in range(300)]
