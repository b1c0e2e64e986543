"""Message rates: asked for, asked again within a second when taken away, reported when they stay low; one owner."""

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import FrameSplitter, WireFrame
from drivers.mavlink.message_rates import MessageRates
from drivers.mavlink.rates_owner import RatesOwner

STEP_S = 0.01


class Stream:
    """A message that comes at a rate which may be changed, and whoever asks for it."""

    def __init__(self, wanted_hz: float, obeys: bool = True) -> None:
        self.rates = MessageRates({"ATTITUDE": wanted_hz})
        self.wanted_hz, self.obeys = wanted_hz, obeys
        self.rate_hz = 1.0
        self.now_s = 0.0
        self.asked: list[float] = []
        self.slow: list[float] = []
        self._due_s = 0.0

    def run(self, seconds: float) -> "Stream":
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += STEP_S
            while self._due_s < self.now_s:
                self._due_s += 1 / self.rate_hz
                self.rates.seen("ATTITUDE")
            requests = self.rates.due(round(self.now_s * 1e6))
            self.asked += [self.now_s] * len(requests)
            if requests and self.obeys:
                self.rate_hz = self.wanted_hz
                self._due_s = min(self._due_s, self.now_s)
            if self.rates.slow:
                self.slow.append(self.now_s)
        return self


@pytest.mark.parametrize("wanted_hz", [5.0, 30.0, 100.0])
def test_a_rate_that_is_taken_away_is_asked_for_again_within_a_second(wanted_hz: float) -> None:
    stream = Stream(wanted_hz).run(5.0)
    assert len(stream.asked) == 1
    for _ in range(3):
        taken_s, count = stream.now_s, len(stream.asked)
        stream.rate_hz = wanted_hz / 25
        stream.run(5.0)
        assert len(stream.asked) == count + 1
        assert stream.asked[-1] - taken_s < 1.0 + 4 * STEP_S + (0.8 if wanted_hz == 5.0 else 0.0)
    assert stream.slow == []


def test_a_rate_that_never_comes_up_is_asked_for_ever_more_rarely_and_reported() -> None:
    stream = Stream(50.0, obeys=False).run(60.0)
    gaps = [b - a for a, b in pairwise(stream.asked)]
    assert gaps == pytest.approx([4, 8, 16, 30], abs=0.1)
    assert 3.0 < stream.slow[0] < 4.5


def test_a_message_that_never_came_is_missing_and_not_slow() -> None:
    """LOCAL_POSITION_NED of an ArduCopter without an origin: asked for all the same, and slow only once it came."""
    stream = Stream(30.0, obeys=False)
    stream._due_s = 40.0
    stream.run(39.0)
    assert len(stream.asked) > 2
    assert stream.slow == []
    stream.run(20.0)
    assert stream.slow[0] > 40.0


def test_a_rate_that_is_a_little_low_is_enough() -> None:
    """All PX4 streams come at 64 % when MAV_n_RATE is too small for them."""
    stream = Stream(100.0, obeys=False)
    stream.rate_hz = 64.0
    stream.run(10.0)
    assert len(stream.asked) == 1
    assert stream.slow == []


def wire(message: object) -> WireFrame:
    data = bytes(message.pack(dialect.MAVLink(None, 1, 191)))
    (frame,) = FrameSplitter().feed(data)
    return frame


def interval(message_id: int) -> object:
    return dialect.MAVLink_command_long_message(
        1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, 1e6, 0, 0, 0, 0, 0
    )


def test_mavsdks_requests_for_our_rates_are_kept_back_and_answered() -> None:
    owner = RatesOwner()
    assert owner.takes(wire(interval(dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)), {"EXTENDED_SYS_STATE"})
    (answer,) = owner.answers(1, 1)
    ack = dialect.MAVLink(None).decode(bytearray(answer))
    assert (ack.command, ack.result) == (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, dialect.MAV_RESULT_ACCEPTED)
    assert (ack.get_srcSystem(), ack.target_system, ack.target_component) == (1, 1, 191)
    assert owner.answers(1, 1) == []


@pytest.mark.parametrize(
    "message",
    [
        interval(dialect.MAVLINK_MSG_ID_HOME_POSITION),
        interval(9_999_999),
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3),
    ],
)
def test_everything_else_of_mavsdks_goes_out(message: object) -> None:
    owner = RatesOwner()
    assert not owner.takes(wire(message), {"EXTENDED_SYS_STATE"})
    assert owner.answers(1, 1) == []


def test_every_message_that_may_be_asked_for_has_an_id() -> None:
    wanted = ("CURRENT_MODE", "MANUAL_CONTROL", "SYS_STATUS", "EXTENDED_SYS_STATE", "RC_CHANNELS")
    rates = MessageRates(dict.fromkeys(wanted, 5.0))
    assert [r.message_id for r in rates.due(0)] == [436, 69, 1, 245, 65]


def test_a_rate_that_somebody_keeps_taking_is_had_again_when_he_stops() -> None:
    # on PX4 the interval that another program asked for stands until somebody asks for another
    stream = Stream(100.0).run(3.0)
    for _ in range(200):
        stream.rate_hz = 4.0
        stream.run(0.3)
    assert stream.slow, "it is reported meanwhile"
    left_s = stream.now_s
    stream.run(6.0)
    assert stream.rate_hz == 100.0
    assert stream.asked[-1] - left_s < stream.rates.first_wait_s + 0.1
