"""The pilot's switch: whether the user wants landings, from the radio, the flight mode or the settings.

Pure: fed with samples, time from their arrival. A switch must have been seen off before it counts as switched on,
so that a daemon that restarts in flight does not repeat a command that was refused.
"""

from companion.settings.settings import LandingSettings
from drivers.samples import Heartbeat, RcChannels, Sample

STICKS = 4
"""Roll, pitch, throttle and yaw are the first four channels."""


class EnableSwitch:
    """``enabled`` says whether the pilot wants landings; every switch that is configured must be on.

    Without a switch ``landing.enabled`` decides. Moving a stick by ``stick_limit_us`` from where it was when the
    switch was turned on ends the wish until the switch was off again.
    """

    def __init__(self, settings: LandingSettings) -> None:
        self._s = settings
        self._radio_on = False
        self._radio_us: int | None = None
        self._mode_on: bool | None = None
        self._seen_off = False
        self._overridden = False
        self._sticks: tuple[int, ...] = ()
        self._sticks_at_start: tuple[int, ...] = ()
        self._now_us = 0
        self.enabled = settings.enabled and not self.has_switch

    @property
    def has_switch(self) -> bool:
        """Whether a switch is configured at all."""
        return self._s.enable_rc_channel > 0 or bool(self._s.enable_modes)

    @property
    def radio_lost(self) -> bool:
        """Whether the radio that the pilot's switch is on is not heard."""
        return self._s.enable_rc_channel > 0 and self._radio_silent()

    @property
    def reason(self) -> str:
        """Why landing is not enabled, in words; empty when it is."""
        if self.enabled:
            return ""
        if not self.has_switch:
            return "landing.enabled is off"
        if not self._wanted():
            return "the pilot's switch is off"
        return "the sticks were moved" if self._overridden else "the pilot's switch must be turned off first"

    def feed(self, sample: Sample) -> bool:
        """Take one sample; whether landing is enabled now."""
        self._now_us = max(self._now_us, sample.arrival_us)
        if isinstance(sample, RcChannels):
            self._radio(sample)
        elif isinstance(sample, Heartbeat):
            self._mode_on = sample.mode in self._s.enable_modes
        if not self.has_switch:
            return self.enabled
        wanted = self._wanted()
        if self._s.enable_rc_channel and self._radio_silent():
            self._seen_off = False  # silence is no switch turned off by hand: it must not renew a permission
        elif not self._s.enable_modes or self._mode_on is not None:
            self._seen_off |= not wanted
        if not wanted:
            self._overridden = False
        elif not self.enabled and self._seen_off and not self._overridden:
            self._sticks_at_start = self._sticks
        self._overridden |= wanted and self._seen_off and self._sticks_moved()
        self.enabled = wanted and self._seen_off and not self._overridden
        return self.enabled

    def _wanted(self) -> bool:
        radio = self._s.enable_rc_channel == 0 or (self._radio_on and not self._radio_silent())
        mode = not self._s.enable_modes or bool(self._mode_on)
        return radio and mode

    def _radio(self, rc: RcChannels) -> None:
        self._sticks = rc.pulse_us[:STICKS]
        channel = self._s.enable_rc_channel
        if channel == 0:
            return
        pulse = rc.pulse_us[channel - 1] if channel <= len(rc.pulse_us) else 0
        if pulse == 0:
            self._radio_us = None
            return
        self._radio_us = rc.arrival_us
        limit = self._s.enable_rc_above_us
        self._radio_on = pulse > (limit - self._s.enable_rc_hysteresis_us if self._radio_on else limit)

    def _radio_silent(self) -> bool:
        return self._radio_us is None or self._now_us - self._radio_us > self._s.enable_rc_max_age_s * 1e6

    def _sticks_moved(self) -> bool:
        limit = self._s.stick_limit_us
        pairs = zip(self._sticks, self._sticks_at_start, strict=False)
        return limit > 0 and any(a and b and abs(a - b) >= limit for a, b in pairs)
