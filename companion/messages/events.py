"""Every event that the core tells of: its name, how grave it is and what it means."""

from typing import Any

from companion.messages.messages import Event

EVENTS = {
    "decision_changed": ("info", "the verdict on the surface below changed"),
    "landing_requested": ("info", "a request to land went out"),
    "clock_settled": ("info", "the autopilot's and the companion's clocks are related"),
    "autopilot_rebooted": ("error", "the autopilot's boot time fell back: it started anew"),
    "boot_time_wrapped": ("info", "the autopilot's boot time started anew after 49.7 days; it goes on"),
    "clock_jumped": ("warning", "the companion's clock was set; the relation to the autopilot was kept"),
    "clock_jump_taken_back": ("warning", "the companion's clock was not set after all: the link was late"),
    "clock_corrected": ("warning", "messages had been late from the beginning; the clocks are related anew"),
    "link_late": ("warning", "telemetry comes late over this link"),
    "frames_jumped": ("warning", "the frames' stamps fell back and went on from there"),
    "camera_late": ("warning", "frames are not as late as camera.time_offset_s says; it is allowed for"),
    "camera_frozen": ("error", "the picture stands still while the vehicle turns"),
    "camera_moves": ("info", "the picture moves again"),
    "attitude_lost": ("warning", "frames have no attitude"),
    "attitude_back": ("info", "frames have an attitude again"),
    "second_vehicle": ("error", "a second vehicle speaks on the link"),
    "input_stale": ("warning", "an input stopped"),
    "input_back": ("info", "an input came back"),
}
"""Name -> (severity, meaning). The command's follow-up adds landing_accepted, landing_started and so on."""


def event(
    name: str, frame: int | None, time_unix_us: int, text: str = "", details: dict[str, Any] | None = None
) -> Event:
    """An event of the table; ``text`` defaults to its meaning."""
    severity, meaning = EVENTS[name]
    return Event(
        event=name,
        frame=frame,
        time_unix_us=time_unix_us,
        severity=severity,
        text=text or meaning,
        details=details or {},
    )
