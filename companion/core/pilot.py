"""The pilot's radio switch and sticks, from RC_CHANNELS and MANUAL_CONTROL. Time is given, none is read."""

from companion.settings.settings import LandingSettings
from drivers.samples import ManualControl, RcChannels, Sample
from landing.decision.permission import Position

STICKS = 4
"""Roll, pitch, throttle and yaw are the first four channels."""
MIDDLE_US, US_PER_UNIT = 1500, 0.5
"""A joystick's -1000 to 1000 as the pulses of a radio's stick."""


class PilotControls:
    """The switch's position with its hysteresis, and where the sticks are.

    A receiver that gives no pulse on the channel leaves the position unclear, as does silence.
    """

    def __init__(self, settings: LandingSettings) -> None:
        self._s = settings
        self._on = False
        self._heard_us: int | None = None
        self._radio_sticks: tuple[int, ...] = (0,) * STICKS
        self._joystick: tuple[int, ...] = (0,) * STICKS

    def feed(self, sample: Sample, now_us: int) -> None:
        """Take one sample."""
        if isinstance(sample, ManualControl):
            self._joystick = tuple(
                0 if axis is None else round(MIDDLE_US + axis * US_PER_UNIT) for axis in sample.axes
            )
        elif isinstance(sample, RcChannels):
            self._radio_sticks = (*sample.pulse_us[:STICKS], *(0,) * STICKS)[:STICKS]
            self._switch(sample.pulse_us, now_us)

    def radio(self, now_us: int) -> Position:
        """The switch's position now."""
        heard = self._heard_us
        if heard is None or now_us - heard > self._s.enable_rc_max_age_s * 1e6:
            return Position.UNCLEAR
        return Position.ON if self._on else Position.OFF

    @property
    def sticks(self) -> tuple[int, ...]:
        """Radio's roll, pitch, throttle, yaw, then the joystick's x, y, z, r, in us; 0 where there is none."""
        return self._radio_sticks + self._joystick

    def _switch(self, pulse_us: tuple[int, ...], now_us: int) -> None:
        channel = self._s.enable_rc_channel
        pulse = pulse_us[channel - 1] if 0 < channel <= len(pulse_us) else 0
        if pulse == 0:
            self._heard_us = None
            return
        self._heard_us = now_us
        limit = self._s.enable_rc_above_us
        self._on = pulse > (limit - self._s.enable_rc_hysteresis_us if self._on else limit)
