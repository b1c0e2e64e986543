"""The [mavlink] and [vehicle] sections as the link takes them."""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from companion.errors import LandslopeError
from companion.settings.settings import Settings
from drivers.mavlink.link import LinkOptions
from drivers.mavlink.ports import is_local, parse_port
from drivers.mavlink.signing import read_key

SYSTEM_STATUS_HZ = 2.0
"""SYS_STATUS says whether the radio is heard."""
FLOWN_STATE_HZ = 20.0
"""Lowest rate of messages that show a takeover (PX4's CURRENT_MODE, sticks) while setpoints may be sent."""
ESTIMATOR_HZ = 2.0
DISTANCE_HZ = 10.0
SYSTEM_TIME_HZ = 1.0
"""SYSTEM_TIME gives the date to a board that does not know it."""


def link_options(settings: Settings, connection: str = "") -> LinkOptions:
    """Options of a link on ``connection``, or on ``mavlink.connection``.

    Raises DriverError on a bad signing key, LandslopeError on a forward endpoint that others reach.
    """
    m = settings.mavlink
    if not m.forward_open:
        _refuse_open(m.forward)
    key = read_key(m.signing_key) if m.signing_key else None
    # who flies by setpoints hears of the pilot's mode and sticks within two of these
    flown = settings.landing.procedure == "offboard"
    state_hz = max(m.state_rate_hz, FLOWN_STATE_HZ) if flown else m.state_rate_hz
    return LinkOptions(
        connection=connection or m.connection,
        system_id=settings.vehicle.system_id,
        autopilot_component=m.autopilot_component,
        own_component=m.component_id,
        rates_hz={
            "ATTITUDE": m.attitude_rate_hz,
            "IMU": m.imu_rate_hz,
            "LOCAL_POSITION_NED": m.position_rate_hz,
            "EXTENDED_SYS_STATE": m.state_rate_hz,
            **({"DISTANCE_SENSOR": DISTANCE_HZ} if settings.vehicle.rangefinder else {}),
            "SYS_STATUS": SYSTEM_STATUS_HZ,
            "SYSTEM_TIME": SYSTEM_TIME_HZ,
            # of these an autopilot has one or two: its estimator about itself
            "EKF_STATUS_REPORT": ESTIMATOR_HZ,
            "ESTIMATOR_STATUS": ESTIMATOR_HZ,
            "ODOMETRY": ESTIMATOR_HZ,
            "CURRENT_MODE": state_hz,
            # a pilot's sticks end a permission, whatever gave it
            "MANUAL_CONTROL": state_hz,
            "RC_CHANNELS": state_hz,
        },
        forward=m.forward,
        signing_key=key,
        signing_memory=None if key is None else state_directory() / f"signing_{_fingerprint(key)}.json",
        timesync_interval_s=1 / m.timesync_rate_hz,
    )


def state_directory() -> Path:
    """Where the service keeps what must survive a restart; in a user's session the user's own place for that."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "landslope"


def _fingerprint(key: bytes) -> str:
    """Distinguishes keys without revealing any."""
    return hashlib.sha256(b"landslope signing time" + key).hexdigest()[:12]


def _refuse_open(forward: Sequence[str]) -> None:
    for connection in forward:
        if not is_local(parse_port(connection)):
            raise LandslopeError(
                f"mavlink.forward: '{connection}' is not on this machine: anybody who reaches it commands the vehicle; "
                "use a loopback address, or set mavlink.forward_open = true"
            )
