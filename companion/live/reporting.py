"""What ground stations see: STATUSTEXT on changes, values at a steady rate, flow for the autopilot's estimator.

Pure: messages of the pipeline in, MAVLink messages out; time comes from the messages.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from companion.messages.conditions import Condition, identity
from companion.messages.events import COMMAND_EVENTS
from companion.messages.messages import Decision, Estimate, Event, Health, Message
from companion.settings.settings import MavlinkSettings
from drivers.samples import Imu

TEXT_LENGTH = 50
"""STATUSTEXT holds this many characters; longer texts would need chunks that few ground stations join."""
SEVERITIES = {
    "info": dialect.MAV_SEVERITY_INFO,
    "warning": dialect.MAV_SEVERITY_WARNING,
    "error": dialect.MAV_SEVERITY_CRITICAL,
}
BOOT_WRAP_MS = 2**32


class GroundReport:
    """Turns messages into what goes out over MAVLink; the texts only when something changed."""

    def __init__(self, settings: MavlinkSettings, body_from_camera: NDArray[np.float64]) -> None:
        self._s = settings
        self._body_from_camera = body_from_camera
        self._gyro = np.zeros(2)
        self._gyro_count = 0
        self._verdict = ""
        self._conditions: dict[tuple[str, str], Condition] = {}
        self._values_due_us = 0

    def set_settings(self, settings: MavlinkSettings) -> None:
        """Other settings of what is sent, from now on."""
        self._s = settings

    def gyro(self, sample: Imu) -> None:
        """Take a gyro sample: OPTICAL_FLOW has the rotation in it, the estimates do not."""
        self._gyro += sample.rate[:2]
        self._gyro_count += 1

    def feed(self, message: Message) -> list[Any]:
        """The pymavlink messages that one message of the pipeline calls for."""
        if isinstance(message, Estimate):
            return self._values(message) + self._flow(message)
        if not self._s.status_text:
            return []
        if isinstance(message, Decision):
            return self._decision(message)
        if isinstance(message, Health):
            return self._health_change(message)
        if isinstance(message, Event) and message.event in COMMAND_EVENTS:
            return [_text(message.severity, message.text.removeprefix("command to "))]
        return []

    def _decision(self, decision: Decision) -> list[Any]:
        if decision.verdict == self._verdict:
            return []
        first, self._verdict = not self._verdict, decision.verdict
        if first and decision.verdict == "unknown":
            return []
        why = f": {decision.reasons[0]}" if decision.reasons else ""
        return [_text("info", f"surface {decision.verdict}{why}")]

    def _health_change(self, health: Health) -> list[Any]:
        """What began and what ended; ages that grow within a condition are no change."""
        was, self._conditions = self._conditions, {identity(c): c for c in health.conditions}
        began = [_text(c.severity, c.text) for key, c in self._conditions.items() if key not in was]
        if was and not self._conditions:
            return [_text("info", "all well")]
        ended = [_text("info", f"over: {c.text}") for key, c in was.items() if key not in self._conditions]
        return began + ended

    def _values(self, e: Estimate) -> list[Any]:
        if self._s.named_value_rate_hz == 0 or e.time_unix_us < self._values_due_us:
            return []
        self._values_due_us = e.time_unix_us + round(1e6 / self._s.named_value_rate_hz)
        boot_ms = round((e.time_boot_s or 0.0) * 1e3) % BOOT_WRAP_MS
        values = {"ls_incl": e.inclination_deg, "ls_ttc": e.time_to_contact_s, "ls_rough": e.roughness}
        return [
            dialect.MAVLink_named_value_float_message(
                boot_ms, name.encode(), math.nan if value is None else value
            )
            for name, value in values.items()
        ]

    def _flow(self, e: Estimate) -> list[Any]:
        if not self._s.optical_flow or e.ventral_flow_x is None or e.ventral_flow_y is None:
            return []
        # Positive flow about an axis is what a right-hand rotation about it makes; so +x motion gives +y flow,
        # and +y motion -x flow. Receivers subtract their own gyro.
        approach = (e.divergence or 0.0) / 2
        velocity = self._body_from_camera @ (e.ventral_flow_x, e.ventral_flow_y, approach)
        gyro = self._gyro / max(self._gyro_count, 1)
        self._gyro, self._gyro_count = np.zeros(2), 0
        return [
            dialect.MAVLink_optical_flow_message(
                time_usec=e.time_unix_us,
                sensor_id=0,
                flow_x=0,
                flow_y=0,
                flow_comp_m_x=0.0,
                flow_comp_m_y=0.0,
                quality=round(255 * (e.inlier_fraction or 0.0)),
                ground_distance=-1.0 if e.height_m is None else e.height_m,
                flow_rate_x=float(gyro[0] - velocity[1]),
                flow_rate_y=float(gyro[1] + velocity[0]),
            )
        ]


def _text(severity: str, text: str) -> Any:
    line = f"landslope: {text}"
    if len(line) > TEXT_LENGTH:
        line = line[: TEXT_LENGTH - 1] + "~"
    return dialect.MAVLink_statustext_message(SEVERITIES[severity], line.encode("ascii", "replace"))
