"""Check of the MAVLink connection before a flight, for ``landslope doctor``.

In: the settings and some seconds of live messages. Out: ``Finding`` (level, text, remedy) on the connection, the
autopilot's parameters, the rate of each message (Hz), the jitter of arrivals (s), the relation of the two clocks (s)
and TIMESYNC. Nothing is commanded; the link only requests message rates and parameters.
"""

import threading
from collections import Counter

import numpy as np

from companion.clocks.clock import AutopilotClock
from companion.core.vehicle_state import MULTICOPTERS
from companion.doctor import parameters
from companion.doctor.findings import DoctorOptions, Finding, Level
from companion.doctor.modes import mode_findings
from companion.doctor.rangefinder import rangefinder_findings
from companion.settings.link_options import link_options
from companion.settings.settings import Settings
from drivers.autopilot.available_modes import ModeReader
from drivers.autopilot.parameters import ParameterReader
from drivers.errors import DriverError
from drivers.events import DriverEvent
from drivers.mavlink.link import Link
from drivers.samples import (
    Attitude,
    ClockOffset,
    Heartbeat,
    Imu,
    LandedState,
    RcChannels,
    Refusal,
    Sample,
    Velocity,
)
from drivers.system.host_clock import now_us

SETTLE_US = 1_500_000
"""Messages of this time (us) after the first heartbeat are left out: the requested rates are not in effect yet."""

SUBJECTS = {
    "attitude": Attitude,
    "gyro": Imu,
    "velocity": Velocity,
    "landed state": LandedState,
    "radio": RcChannels,
}
"""Subject of a finding -> kind of sample whose rate is measured."""
RATE_REMEDY = (
    "raise the link's baud rate, or lower the rate in [mavlink]; PX4: MAV_n_RATE bounds all messages together; "
    "ArduPilot: SRn_... and other programs ask for other rates"
)


class LinkExamination:
    """Opens the link at once and collects its samples in the link's thread; ``findings`` evaluates them.

    A connection that cannot be opened is a finding, not an exception.
    """

    def __init__(self, settings: Settings, options: DoctorOptions) -> None:
        self._settings, self._options = settings, options
        self._lock = threading.Lock()
        self._samples: list[Sample] = []
        self._events: list[DriverEvent] = []
        self._link: Link | None = None
        self._fault = ""
        if not settings.mavlink.connection:
            self._fault = "mavlink.connection is not set"
            return
        try:
            self._link = Link(link_options(settings), self._keep, self._report)
            self._parameters = ParameterReader(self._link)
            self._modes = ModeReader(self._link)
            self._link.on_frame = self._frame
            self._link.start()
        except DriverError as error:
            self._fault = str(error)

    def look(self) -> None:
        """Request the parameters that have not arrived yet; to be called every few tenths of a second."""
        if self._link is not None:
            wanted = parameters.names(self._settings.landing.procedure, self._link.autopilot)
            self._parameters.look(wanted, now_us())
            self._modes.look(now_us())

    def close(self) -> None:
        """Close the port."""
        if self._link is not None:
            self._link.close()

    def findings(self) -> list[Finding]:
        """All findings; only one, with the cause, when no heartbeat of the autopilot was received."""
        with self._lock:
            samples, events = list(self._samples), list(self._events)
        connection = self._settings.mavlink.connection
        if self._link is None:
            return [Finding("link", "failure", self._fault, "set mavlink.connection, as /dev/ttyAMA0:921600")]
        closed = [event.text for event in events if event.event == "link_closed"]
        heartbeats = [sample for sample in samples if isinstance(sample, Heartbeat)]
        if not heartbeats:
            if not self._link.is_open:
                remedy = "is the device there, the user in the group 'dialout', no other program on it?"
                return [
                    Finding(
                        "link", "failure", f"{connection}: {(closed or ['cannot be opened'])[-1]}", remedy
                    )
                ]
            heard = self._link.counters["bytes in"]
            if heard:
                remedy = "check the baud rate, vehicle.system_id and mavlink.autopilot_component; signing?"
                return [
                    Finding(
                        "link", "failure", f"{heard} bytes came, but no heartbeat of the autopilot", remedy
                    )
                ]
            remedy = "check wiring, baud rate, the autopilot's SERIALn_PROTOCOL or MAV_n_CONFIG, addresses"
            return [Finding("link", "failure", f"{connection} is open, and silent", remedy)]
        newest = heartbeats[-1]
        armed = "armed" if newest.armed else "disarmed"
        text = f"{connection}: {newest.autopilot}, system {self._link.system_id}, mode {newest.mode}, {armed}"
        findings = [Finding("link", "ok", text)]
        if self._link.ambiguous:
            findings.append(
                Finding("link", "failure", "more than one vehicle speaks on it", "set vehicle.system_id")
            )
        findings += rangefinder_findings(self._settings.vehicle.rangefinder, samples)
        procedure = self._settings.landing.procedure
        findings += parameters.parameter_findings(procedure, newest.autopilot, self._parameters.values)
        if newest.autopilot == "px4" or newest.vehicle_type in MULTICOPTERS:  # whose numbers these are
            findings += mode_findings(self._settings.landing, self._modes.modes())
        findings += self._rates(samples, newest)
        findings += self._clock(samples)
        known_us = heartbeats[0].arrival_us  # before it the link cannot know which messages are the vehicle's
        late = (s for s in samples if isinstance(s, Refusal) and s.arrival_us > known_us)
        refused = Counter((refusal.reason.words, refusal.detail) for refusal in late)
        if refused:
            text = ", ".join(f"{count} x {why} ({what})" for (why, what), count in refused.most_common(3))
            findings.append(
                Finding("refused", "warning", text, "noise on the wire, or somebody else on the link")
            )
        return findings

    def _frame(self, arrival_us: int, data: bytes) -> None:
        self._parameters.frame(arrival_us, data)
        self._modes.frame(arrival_us, data)

    def _keep(self, samples: list[Sample]) -> None:
        with self._lock:
            self._samples += samples

    def _report(self, event: DriverEvent) -> None:
        with self._lock:
            self._events.append(event)

    def _rates(self, samples: list[Sample], heartbeat: Heartbeat) -> list[Finding]:
        """One finding for each subject: its mean rate since ``SETTLE_US``, against the requested one."""
        m = self._settings.mavlink
        asked = {
            "attitude": m.attitude_rate_hz,
            "gyro": m.imu_rate_hz,
            "velocity": m.position_rate_hz,
            "landed state": m.state_rate_hz,
        }
        found_us = next(sample.arrival_us for sample in samples if isinstance(sample, Heartbeat))
        settled = [sample for sample in samples if sample.arrival_us >= found_us + SETTLE_US]
        end_us = max((sample.arrival_us for sample in samples), default=0)
        span_s = (end_us - found_us - SETTLE_US) * 1e-6
        if span_s <= 0:
            return [
                Finding(
                    "messages",
                    "warning",
                    "the vehicle appeared too late to measure rates",
                    "look again, or --seconds 10",
                )
            ]
        findings = []
        channel = self._settings.landing.enable_rc_channel
        asked |= {"radio": m.state_rate_hz} if channel else {}
        for subject in asked:
            kind = SUBJECTS[subject]
            times = np.array([sample.arrival_us for sample in settled if isinstance(sample, kind)], np.int64)
            rate_hz = len(times) / span_s
            text = f"{rate_hz:.1f} Hz of {asked[subject]:g} asked for"
            remedy = RATE_REMEDY
            if not len(times):
                level: Level = "failure" if subject in ("attitude", "radio") else "warning"
                if subject == "radio":
                    remedy = (
                        f"RC channel {channel} enables landing; without RC_CHANNELS nothing is ever requested"
                    )
                findings.append(
                    Finding(subject, level, "none comes", f"{heartbeat.autopilot} sends none: {remedy}")
                )
            elif rate_hz < self._options.rate_share * asked[subject]:
                findings.append(Finding(subject, "warning", text, remedy))
            else:
                findings.append(Finding(subject, "ok", text))
        return findings

    def _clock(self, samples: list[Sample]) -> list[Finding]:
        """Jitter of the attitude's arrivals, standard deviation of the clocks' relation, TIMESYNC round trips."""
        o = self._options
        clock = AutopilotClock(self._settings.sync)
        delays: list[int] = []
        trips: list[int] = []
        for sample in samples:
            if isinstance(sample, Attitude):
                clock.feed(sample.boot_us, sample.arrival_us)
                delays.append(sample.arrival_us - sample.boot_us)
            elif isinstance(sample, ClockOffset):
                clock.feed_round_trip(
                    sample.boot_us, sample.arrival_us, sample.offset_us, sample.round_trip_us
                )
                trips.append(sample.round_trip_us)
        findings = []
        if delays:
            late = np.array(delays) - min(delays)
            jitter_s = float(np.percentile(late, 95)) * 1e-6
            text = f"19 of 20 messages within {jitter_s * 1e3:.1f} ms of the fastest"
            well = jitter_s <= o.max_link_jitter_s
            remedy = "" if well else "a wire instead of radio or WiFi; fewer messages; a higher baud rate"
            findings.append(Finding("link jitter", "ok" if well else "warning", text, remedy))
        if not clock.settled or clock.std_s > o.max_clock_std_s:
            doubt = f"uncertain by {clock.std_s * 1e3:.1f} ms" if clock.settled else "not known yet"
            findings.append(Finding("clock", "warning", f"the autopilot's time is {doubt}", "--seconds 15"))
        else:
            findings.append(
                Finding("clock", "ok", f"related to the autopilot's within {clock.std_s * 1e3:.2f} ms")
            )
        if not trips:
            remedy = "the autopilot or a router between answers no TIMESYNC; arrivals alone will do"
            findings.append(Finding("timesync", "warning", "no answer", remedy))
        else:
            shortest_s = min(trips) * 1e-6
            well = shortest_s <= o.max_round_trip_s
            text = f"{len(trips)} round trips, the shortest {shortest_s * 1e3:.1f} ms"
            remedy = "" if well else "a long way: a wire instead of a radio"
            findings.append(Finding("timesync", "ok" if well else "warning", text, remedy))
        return findings
