"""One look before a flight: settings, camera, link, clock, disk and zenoh, each with the remedy."""

import time
from collections.abc import Iterator

from companion.doctor.camera import CameraExamination
from companion.doctor.findings import DoctorOptions, Finding
from companion.doctor.link import LinkExamination
from companion.doctor.system import disk_findings, instance_findings, settings_findings, zenoh_findings
from companion.settings.settings_file import LoadedSettings

LOOK_S = 0.1


def examine(
    loaded: LoadedSettings, seconds: float, options: DoctorOptions | None = None
) -> Iterator[Finding]:
    """Look at everything; camera and link are watched side by side for ``seconds``."""
    options = options or DoctorOptions()
    settings = loaded.settings
    yield from settings_findings(loaded)
    yield from instance_findings(settings)
    camera = CameraExamination(settings, options)
    link = LinkExamination(settings, options)
    try:
        until = time.monotonic() + seconds
        while (left_s := until - time.monotonic()) > 0:
            before = time.monotonic()
            camera.look(min(LOOK_S, left_s))
            if time.monotonic() - before < LOOK_S / 10:
                time.sleep(min(LOOK_S / 10, left_s))  # a camera at its end has nothing to wait for
        yield from camera.findings()
        yield from link.findings()
    finally:
        camera.close()
        link.close()
    yield from disk_findings(settings)
    yield from zenoh_findings(settings)
