"""One look before a flight: settings, camera, link, clock, disk and zenoh, each with the remedy."""

import time
from collections.abc import Iterator

from companion.doctor.camera import CameraExamination
from companion.doctor.findings import DoctorOptions, Finding
from companion.doctor.link import LinkExamination
from companion.doctor.running import running, running_findings
from companion.doctor.system import disk_findings, settings_findings, zenoh_findings
from companion.settings.settings import Settings
from companion.settings.settings_file import LoadedSettings

LOOK_S = 0.1


def examine(
    loaded: LoadedSettings, seconds: float, options: DoctorOptions | None = None
) -> Iterator[Finding]:
    """Look at everything; camera and link are watched side by side for ``seconds``, unless a landslope has them."""
    options = options or DoctorOptions()
    settings = loaded.settings
    yield from _guarded("settings", settings_findings(loaded))
    others = False
    try:
        service = running(settings)
        if service is not None:
            others = True
            yield from running_findings(service)
    except OSError as error:
        others = True
        yield _closed("service", error)
    if not others:
        yield from _camera_and_link(settings, seconds, options)
    yield from _guarded("disk", disk_findings(settings))
    if not others:
        yield from _guarded("zenoh", zenoh_findings(settings))


def _camera_and_link(settings: Settings, seconds: float, options: DoctorOptions) -> Iterator[Finding]:
    camera = CameraExamination(settings, options)
    link = LinkExamination(settings, options)
    try:
        until = time.monotonic() + seconds
        while (left_s := until - time.monotonic()) > 0:
            before = time.monotonic()
            camera.look(min(LOOK_S, left_s))
            link.look()
            if time.monotonic() - before < LOOK_S / 10:
                time.sleep(min(LOOK_S / 10, left_s))  # a camera at its end has nothing to wait for
        yield from camera.findings()
        yield from link.findings()
    finally:
        camera.close()
        link.close()


def _guarded(subject: str, findings: Iterator[Finding]) -> Iterator[Finding]:
    """What may not be looked at is a finding, and the rest is looked at all the same."""
    try:
        yield from findings
    except OSError as error:
        yield _closed(subject, error)


def _closed(subject: str, error: OSError) -> Finding:
    remedy = "look as the service's user: sudo -u landslope, or join the group 'landslope'"
    return Finding(subject, "failure", f"{error.filename or 'a file'}: {error.strerror or error}", remedy)
