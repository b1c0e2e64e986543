"""Messages unpacked here are the ones that pymavlink decodes."""

import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import FrameSplitter, WireFrame
from drivers.mavlink.telemetry import MESSAGE_IDS
from drivers.mavlink.unpacking import PLAIN, Unpacker


@pytest.mark.parametrize("message_id", sorted(MESSAGE_IDS & PLAIN))
@given(data=st.data())
@examples(15)
def test_it_says_what_pymavlink_says(message_id: int, data: st.DataObject) -> None:
    kind = dialect.mavlink_map[message_id]
    size = kind.unpacker.size
    raw = data.draw(st.binary(min_size=size, max_size=size) | st.just(bytes(size)))
    values = kind.unpacker.unpack(raw)
    message = kind(*[values[place] for place in kind.orders])
    old = message_id <= 255 and data.draw(st.booleans())
    packed = bytes(message.pack(dialect.MAVLink(None, 7, 3), force_mavlink1=old))
    (frame,) = FrameSplitter().feed(packed)
    assert isinstance(frame, WireFrame)
    ours, theirs = Unpacker().unpack(frame), dialect.MAVLink(None).decode(bytearray(packed))
    assert repr(ours.to_dict()) == repr(theirs.to_dict())
    assert (ours.get_srcSystem(), ours.get_srcComponent(), ours.get_seq()) == (7, 3, theirs.get_seq())
