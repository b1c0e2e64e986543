"""Whose frame it is, without a link."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.mavlink.framing import WireFrame
from drivers.mavlink.identity import VehicleIdentity
from drivers.refusals import SECOND_GONE_S


def test_a_second_vehicle_that_left_leaves_no_ambiguity() -> None:
    def beat(system: int, number: int) -> WireFrame:
        codec = dialect.MAVLink(None, system, 1)
        packet = dialect.MAVLink_heartbeat_message(2, 3, 81, 4, 4, 3).pack(codec)
        return WireFrame(bytes(packet), 0, system, 1, number, signed=False, known=True)

    identity = VehicleIdentity(0, 1, 191)
    for k in range(30):
        identity.check(beat(3, k), None, k * 1_000_000)
        if k == 5:
            identity.check(beat(4, k), None, k * 1_000_000)
        assert identity.ambiguous == (5 <= k <= 5 + SECOND_GONE_S)
