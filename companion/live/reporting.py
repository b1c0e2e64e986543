"""What ground stations see: STATUSTEXT on changes, values at a steady rate, flow for the autopilot's estimator.

Pure: messages of the pipeline in, MAVLink messages out; time comes from the messages.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from companion.live.status_texts import StatusTexts
from companion.messages.messages import Decision, Estimate, Event, Health, Message
from companion.settings.settings import MavlinkSettings
from drivers.samples import Imu

BOOT_WRAP_MS = 2**32
LONGEST_FLOW_US = 500_000
"""Flow is integrated from estimate to estimate; over a longer gap none is sent."""


class GroundReport:
    """Turns messages into what goes out over MAVLink; the texts only when something changed."""

    def __init__(self, settings: MavlinkSettings, body_from_camera: NDArray[np.float64]) -> None:
        self._s = settings
        self._body_from_camera = body_from_camera
        self.autopilot = ""
        """As heartbeats name it: PX4 takes OPTICAL_FLOW_RAD alone."""
        self._gyro = np.zeros(3)
        self._gyro_count = 0
        self._flow_us: int | None = None
        self._texts = StatusTexts()
        self._values_due_us = 0

    def set_settings(self, settings: MavlinkSettings) -> None:
        """Other settings of what is sent, from now on."""
        self._s = settings

    def gyro(self, sample: Imu) -> None:
        """Take a gyro sample: OPTICAL_FLOW has the rotation in it, the estimates do not."""
        self._gyro += sample.rate
        self._gyro_count += 1

    def feed(self, message: Message) -> list[Any]:
        """The pymavlink messages that one message of the pipeline calls for."""
        if isinstance(message, Estimate):
            return self._values(message) + self._flow(message)
        if not self._s.status_text:
            return []
        if isinstance(message, Decision):
            return self._texts.decision(message)
        if isinstance(message, Health):
            return self._texts.health(message)
        return self._texts.event(message) if isinstance(message, Event) else []

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
        self._gyro, self._gyro_count = np.zeros(3), 0
        flow_x, flow_y = float(gyro[0] - velocity[1]), float(gyro[1] + velocity[0])
        quality = round(255 * (e.inlier_fraction or 0.0))
        height_m = -1.0 if e.height_m is None else e.height_m
        if self.autopilot != "px4":
            return [
                dialect.MAVLink_optical_flow_message(
                    time_usec=e.time_unix_us,
                    sensor_id=0,
                    flow_x=0,
                    flow_y=0,
                    flow_comp_m_x=0.0,
                    flow_comp_m_y=0.0,
                    quality=quality,
                    ground_distance=height_m,
                    flow_rate_x=flow_x,
                    flow_rate_y=flow_y,
                )
            ]
        before_us, self._flow_us = self._flow_us, e.time_unix_us
        span_us = 0 if before_us is None else e.time_unix_us - before_us
        if not 0 < span_us <= LONGEST_FLOW_US:
            return []
        span_s = span_us * 1e-6
        return [
            dialect.MAVLink_optical_flow_rad_message(
                time_usec=e.time_unix_us,
                sensor_id=0,
                integration_time_us=span_us,
                integrated_x=flow_x * span_s,
                integrated_y=flow_y * span_s,
                integrated_xgyro=float(gyro[0]) * span_s,
                integrated_ygyro=float(gyro[1]) * span_s,
                integrated_zgyro=float(gyro[2]) * span_s,
                temperature=0,
                quality=quality,
                time_delta_distance_us=0,
                distance=height_m,
            )
        ]
