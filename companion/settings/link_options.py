"""The [mavlink] and [vehicle] sections as the link takes them."""

from pathlib import Path

from companion.settings.settings import Settings
from drivers.mavlink.link import LinkOptions
from drivers.mavlink.signing import read_key

SYSTEM_STATUS_HZ = 2.0
"""SYS_STATUS says whether the radio is heard."""


def link_options(settings: Settings, connection: str = "") -> LinkOptions:
    """Options of a link on ``connection``, or on ``mavlink.connection``. Raises DriverError on a bad signing key."""
    m = settings.mavlink
    radio = {"RC_CHANNELS": m.state_rate_hz} if settings.landing.enable_rc_channel else {}
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
            "SYS_STATUS": SYSTEM_STATUS_HZ,
            "CURRENT_MODE": m.state_rate_hz,
            "MANUAL_CONTROL": m.state_rate_hz,
        }
        | radio,
        forward=m.forward,
        signing_key=read_key(Path(m.signing_key)) if m.signing_key else None,
        timesync_interval_s=1 / m.timesync_rate_hz,
    )
