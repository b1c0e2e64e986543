"""The machine before a flight: settings' files, the disk, zenoh."""

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

from companion.doctor.findings import Finding
from companion.live.publisher import endpoints
from companion.settings.listing import missing_files
from companion.settings.settings import Settings
from companion.settings.settings_file import LoadedSettings
from drivers.bus import Bus
from drivers.errors import DriverError
from drivers.secrets import is_key

SERVICE_USER = "landslope"
MB = 1_000_000
ZENOH_WAIT_S = 2.0


def settings_findings(loaded: LoadedSettings) -> Iterator[Finding]:
    """Files that the settings name, and whether a landing can ever be requested."""
    missing = list(missing_files(loaded))
    for text in missing:
        yield Finding("settings", "failure", text, "put the file there, or correct the setting")
    if not missing:
        yield Finding("settings", "ok", str(loaded.file) if loaded.file else "defaults alone, no file")
    for note in loaded.notes:
        yield Finding("settings", "warning", note, "correct the file")
    landing = loaded.settings.landing
    ways = []
    if landing.enable_rc_channel:
        ways.append(f"by RC channel {landing.enable_rc_channel}")
    if landing.enable_modes:
        ways.append(f"by choosing mode {' or '.join(landing.enable_modes)}")
    if not ways and landing.enabled:
        ways.append("from the start")
    if not ways:
        yield Finding("landing", "ok", "not enabled: landslope measures and reports, and requests nothing")
    elif landing.enable_modes and not set(landing.enable_modes) & set(landing.allowed_modes):
        text = f"enabled {' and '.join(ways)}, but landing.allowed_modes has none of these modes"
        yield Finding("landing", "warning", text, "add the mode to landing.allowed_modes")
    else:
        allowed = ", ".join(landing.allowed_modes)
        yield Finding("landing", "ok", f"enabled {' and '.join(ways)}, in modes {allowed}")
    yield from _key_findings(loaded)


def _key_findings(loaded: LoadedSettings) -> Iterator[Finding]:
    """Where the signing key is, and whether others can read it: who has it commands the vehicle."""
    given = loaded.settings.mavlink.signing_key
    if not given:
        return
    inline = is_key(given)
    where = loaded.file if inline else Path(given)
    what = "stands in mavlink.signing_key itself" if inline else f"is read from the file {given}"
    if where is not None and where.is_file() and where.stat().st_mode & 0o007:
        yield Finding(
            "signing key", "warning", f"{what}; {where} is readable by everybody", f"chmod 640 {where}"
        )
    else:
        yield Finding("signing key", "ok", what)


def disk_findings(settings: Settings) -> Iterator[Finding]:
    """Whether flights can be recorded."""
    record = settings.record
    if not record.directory:
        yield Finding("disk", "ok", "record.directory is empty: no flight is recorded")
        return
    directory = Path(record.directory)
    there = next((path for path in (directory, *directory.parents) if path.exists()), Path("/"))
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        if there.is_dir() and os.geteuid() != there.stat().st_uid and there.owner() == SERVICE_USER:
            text = f"{directory} belongs to {SERVICE_USER}: whether it can be written shows as that user"
            yield Finding("disk", "warning", text, f"look as the service's user: sudo -u {SERVICE_USER}")
            return
        remedy = "give it to the service's user: chown landslope, or choose another record.directory"
        yield Finding("disk", "failure", f"{directory} cannot be written", remedy)
        return
    free_mb = shutil.disk_usage(there).free // MB
    text = f"{directory}: {free_mb} MB free"
    if free_mb < record.min_free_mb:
        yield Finding(
            "disk", "failure", f"{text}, record.min_free_mb is {record.min_free_mb}", "delete old flights"
        )
    elif free_mb < record.min_free_mb + record.max_flight_mb:
        yield Finding("disk", "warning", f"{text}: a long flight will not fit", "delete old flights")
    else:
        yield Finding("disk", "ok", text)


def zenoh_findings(settings: Settings) -> Iterator[Finding]:
    """Whether messages get out, and whether somebody is there."""
    try:
        bus = Bus(settings.vehicle.name, endpoints(settings.zenoh))
    except DriverError as error:
        yield Finding(
            "zenoh", "failure", str(error), "check zenoh.connect, zenoh.listen, the router and certificates"
        )
        return
    try:
        session = bus.session
        if session is None:
            yield Finding(
                "zenoh", "failure", "no session", "check zenoh.connect, zenoh.listen and the router"
            )
            return
        until = time.monotonic() + ZENOH_WAIT_S
        routers, peers = 0, 0
        while time.monotonic() < until and not routers + peers:
            time.sleep(ZENOH_WAIT_S / 20)
            routers, peers = len(list(session.info.routers_zid())), len(list(session.info.peers_zid()))
        text = f"open, {routers} routers, {peers} peers"
        lonely = not routers + peers
        if lonely and settings.zenoh.connect:
            remedy = f"is {', '.join(settings.zenoh.connect)} up and reachable?"
            yield Finding("zenoh", "warning", text, remedy)
        elif routers and settings.zenoh.mode == "peer":
            remedy = 'set zenoh.mode = "client": watchers that are peers of that router as well hear nothing'
            yield Finding("zenoh", "warning", text, remedy)
        else:
            yield Finding("zenoh", "ok", text if not lonely else f"{text}: nobody listens yet")
    finally:
        bus.close()
