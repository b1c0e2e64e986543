"""Every event: its name, its severity and what it means."""

from typing import Any

from companion.messages.messages import Event

EVENTS = {
    "decision_changed": ("info", "the verdict on the surface below changed"),
    "landing_enabled": ("info", "landing is enabled"),
    "landing_disabled": ("info", "landing is not enabled"),
    "procedure_changed": ("info", "the landing procedure changed its state"),
    "procedure_gave_back": ("warning", "the landing procedure gave control back"),
    "landing_requested": ("info", "a request to land went out"),
    "clock_settled": ("info", "the autopilot's and the companion's clocks are related"),
    "autopilot_rebooted": ("error", "the autopilot's boot time fell back: it started anew"),
    "boot_time_wrapped": ("info", "the autopilot's boot time started anew after 49.7 days; it goes on"),
    "clock_jumped": ("warning", "the companion's clock was set; the relation to the autopilot was kept"),
    "clock_jump_taken_back": ("warning", "the companion's clock was not set after all: the link was late"),
    "clock_corrected": ("warning", "messages had been late from the beginning; the clocks are related anew"),
    "link_late": ("warning", "telemetry comes late over this link"),
    "frames_jumped": ("warning", "the frames' stamps fell back and went on from there"),
    "camera_late": ("warning", "frames are not as late as camera.time_offset_s says; this is corrected"),
    "readout_found": ("warning", "the camera has a rolling shutter that is not set; this is corrected"),
    "camera_frozen": ("error", "the picture stands still while the vehicle turns"),
    "camera_moves": ("info", "the picture moves again"),
    "mask_grown": ("info", "a part of the picture stands still while the ground moves; it is masked"),
    "mask_shrunk": ("info", "a part of the picture moves with the ground after all; it is used again"),
    "rotation_contradicts": (
        "error",
        "the picture does not turn as the gyro does: check the camera's mount angles, a mirrored or rotated picture, "
        "the focal length, and whether the picture is old or repeated; there is no estimate until they agree",
    ),
    "velocity_contradicts": (
        "error",
        "the ground does not move as the vehicle's velocity says: check the camera's mount angles, a mirrored picture, "
        "whether the picture is old or repeated, and whether the ground moves; there is no estimate until they agree",
    ),
    "lateness_contradicts": (
        "error",
        "the pictures are later than can be found, or not as late as they were: check camera.time_offset_s and what "
        "buffers the picture; there is no estimate until they agree",
    ),
    "height_contradicts": (
        "error",
        "the rangefinder's distance is not the height that velocity and pictures give: check its mount and limits, "
        "what hangs below it, the focal length and the autopilot's velocity; there is no estimate until they agree",
    ),
    "motion_agrees": ("info", "pictures, gyro, velocity and rangefinder agree again"),
    "attitude_lost": ("warning", "frames have no attitude"),
    "attitude_back": ("info", "frames have an attitude again"),
    "second_vehicle": ("error", "a second vehicle speaks on the link"),
    "second_vehicle_gone": ("info", "the second vehicle was not heard for ten seconds"),
    "input_stale": ("warning", "an input stopped"),
    "date_known": ("info", "the date is known from now on; times that are published are right"),
    "date_corrected": ("warning", "the date was corrected; times that are published step"),
    "settings_reloaded": ("info", "settings were read again"),
    "settings_refused": ("error", "settings could not be read again; the old ones stay in force"),
    "input_back": ("info", "an input came back"),
    "landing_in_progress": ("info", "the autopilot works on the command to land"),
    "landing_accepted": ("info", "the autopilot accepted the command to land"),
    "landing_started": ("info", "the flight mode became LAND"),
    "landing_landed": ("info", "the vehicle is on the ground or disarmed"),
    "landing_refused": ("warning", "the autopilot refused the command to land"),
    "landing_failed": ("warning", "the command to land had no effect"),
    "landing_taken_over": ("warning", "the flight mode left LAND before the touchdown"),
    "landing_held": ("info", "the landing ended by our own request to hold"),
    "landing_failsafe": ("warning", "the autopilot left LAND in a failsafe"),
    "surface_unfit": ("error", "the surface turned out unfit during the landing"),
    "hold_accepted": ("info", "the autopilot accepted the request to hold"),
    "hold_failed": ("error", "the autopilot did not accept the request to hold"),
    "link_open": ("info", "the MAVLink port is open"),
    "link_closed": ("warning", "the MAVLink port is closed; it is opened again"),
    "vehicle_found": ("info", "an autopilot's heartbeat was heard"),
    "mavlink_refused": ("warning", "frames on the link are refused"),
    "rate_too_low": ("warning", "a message comes more rarely than requested"),
    "camera_lost": ("warning", "the camera gives no frames"),
    "camera_back": ("info", "the camera gives frames again"),
    "camera_stuck": ("error", "every read of the camera hangs; the process ends to be started anew"),
    "stream_times_made_up": ("warning", "the stream's presentation times do not keep the pace of its frames"),
    "camera_ended": ("info", "the video is at its end"),
    "recording_started": ("info", "a flight folder was opened"),
    "recording_stopped": ("info", "the recording ended"),
    "recording_refused": ("error", "there is no room for a recording"),
    "recording_behind": ("warning", "the disk is too slow; parts of the recording are lost"),
    "recording_failed": ("error", "the recording could not be written; it is tried again"),
    "recording_continued": ("info", "a flight folder has its size, the recording goes on in a new one"),
    "recording_renamed": ("info", "a flight folder got the name of its true time"),
    "recording_deleted": ("info", "the oldest flight folder made room"),
}
"""Name -> (severity, meaning)."""

REPEATING = frozenset(
    {
        "clock_settled",
        "clock_jumped",
        "clock_jump_taken_back",
        "clock_corrected",
        "link_late",
        "frames_jumped",
        "camera_late",
        "camera_frozen",
        "camera_moves",
        "mask_grown",
        "mask_shrunk",
        "rotation_contradicts",
        "velocity_contradicts",
        "lateness_contradicts",
        "height_contradicts",
        "motion_agrees",
        "attitude_lost",
        "attitude_back",
        "input_stale",
        "input_back",
        "date_corrected",
        "link_open",
        "link_closed",
        "mavlink_refused",
        "rate_too_low",
        "camera_lost",
        "camera_back",
        "stream_times_made_up",
        "recording_behind",
        "recording_failed",
    }
)
"""Events about inputs and the disk, which a bad cable repeats without end: their rate is limited, with a count."""

LANDING_EVENTS = frozenset(
    {
        "landing_requested",
        "landing_in_progress",
        "landing_accepted",
        "landing_started",
        "landing_landed",
        "landing_refused",
        "landing_failed",
        "landing_taken_over",
        "landing_held",
        "landing_failsafe",
    }
)
"""The request to land and what became of it."""

COMMAND_EVENTS = LANDING_EVENTS | {"surface_unfit", "hold_accepted", "hold_failed"}
"""Everything that concerns a command to the autopilot; ground stations get these as STATUSTEXT."""


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
