"""Makes the pictures of README and docs (``PYTHONPATH=tests/support:tests/stand_ins``; needs Chromium and ffmpeg).

A flight is replayed into the real page; look at the pictures before they are committed.
"""

import base64
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from monitor_support import Browser, Monitor, Vehicle, decision, eventually, health
from places import DOCS, SITL_LOGS
from ports import free_endpoint, free_tcp_port

from companion.messages.messages import Decision
from drivers.bus import Endpoints, open_session

PICTURES = DOCS / "pictures"
FLIGHT = SITL_LOGS / "stairs_a"
ON_THE_STAIRS = 390
"""Frame at which the page is taken: by the flight's own time, a busy machine shows it late."""
MOST_S = 120.0
FLEET = (
    ("unfit", "too steep: 24.0 degrees, limit 10.0", 24.0),
    ("fit", "", 1.5),
    ("unknown", "no estimate: motion too small", 0.5),
    ("fit", "", 3.0),
    ("unfit", "too rough: 0.0310 of the distance, limit 0.0090", 6.0),
    ("fit", "", 0.8),
    ("fit", "", 2.2),
    ("unknown", "inclination uncertain", 4.0),
    ("fit", "", 1.1),
)


def shot(browser: Browser, name: str, scale: float, height: int | None = None) -> None:
    """A picture of the whole page, or of its upper ``height`` pixels."""
    whole, width = browser.script("return [document.documentElement.scrollHeight, innerWidth]")
    clip = {"x": 0, "y": 0, "width": width, "height": min(height or whole, whole), "scale": scale}
    taken = browser.driver.execute_cdp_cmd(
        "Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip}
    )
    image = cv2.imdecode(np.frombuffer(base64.b64decode(taken["data"]), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(PICTURES / name), image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(PICTURES / name)


def replaying(endpoint: str) -> "subprocess.Popen[bytes]":
    """The flight at its own pace into the router."""
    words: list[Any] = ["replay", FLIGHT, "--realtime", "--publish", "--enable-after", "20"]
    for setting in ("zenoh.mode=client", f"zenoh.connect={endpoint}", "vehicle.name=drone-07"):
        words += ["--set", setting]
    return subprocess.Popen(
        [sys.executable, "-m", "companion.cli", *map(str, words)], stdout=subprocess.DEVNULL
    )


def frame_of(browser: Browser) -> int:
    """The frame that the page shows; 0 before there is one."""
    words = browser.texts().get("frame", "").split()
    return int(words[1].rstrip(":")) if len(words) > 1 else 0


def connected(browser: Browser) -> bool:
    """Whether the page has its connection: NiceGUI covers it otherwise."""
    return bool(
        browser.script("return document.getElementById('popup').getAttribute('aria-hidden') === 'true'")
    )


def theme(browser: Browser, name: str) -> None:
    """Press the button until the theme is there."""
    while browser.script("return document.documentElement.dataset.theme") != name:
        browser.script("landslopeTheme()")
    time.sleep(1.2)


def said(verdict: str, reason: str) -> Decision:
    """What a vehicle of the fleet decides."""
    return decision(
        verdict=verdict, reasons=(reason,) if reason else (), withheld=("landing is not enabled",)
    )


def pages(browser: Browser, monitor: Monitor, endpoint: str) -> None:
    """The page over the stairs in each theme, with the fleet, and empty."""
    browser.open(monitor.url)
    time.sleep(1)
    shot(browser, "monitor_empty.png", 0.6, 520)
    replay = replaying(endpoint)
    try:
        browser.open(f"{monitor.url}/?vehicle=drone-07")
        assert eventually(lambda: frame_of(browser) >= ON_THE_STAIRS and connected(browser), MOST_S)
        shot(browser, "monitor.png", 0.6)
        theme(browser, "sunlight")
        assert eventually(lambda: connected(browser), MOST_S)
        shot(browser, "monitor_sunlight.png", 0.5, 1000)
        theme(browser, "dark")
        browser.narrow(390)
        time.sleep(1)
        shot(browser, "monitor_phone.png", 0.5, 1000)
        browser.wide()
        theme(browser, "light")
    finally:
        replay.kill()
        replay.wait()


def fleet(browser: Browser, monitor: Monitor, endpoint: str) -> None:
    """Ten vehicles, of which one has fallen silent: the replayed one."""
    well = msgspec.structs.replace(health(), state="ok", problems=(), inputs={})
    vehicles = [Vehicle(f"drone-{n:02d}", endpoint) for n in (1, 2, 3, 4, 5, 6, 8, 9, 10)]
    try:
        browser.open(f"{monitor.url}/?vehicle=drone-02")
        for _ in range(5):
            for vehicle, (verdict, reason, degrees) in zip(vehicles, FLEET, strict=True):
                vehicle.inclination_deg = degrees
                vehicle.say(said(verdict, reason))
                vehicle.say(health() if vehicle is vehicles[3] else well)
            time.sleep(1)
        shot(browser, "monitor_fleet.png", 0.6, 700)
    finally:
        for vehicle in vehicles:
            vehicle.close()


def report(browser: Browser, folder: Path) -> None:
    """The report, at a moment on the stairs."""
    page = folder / "stairs_a.html"
    words = ["replay", str(FLIGHT), "--enable-after", "8", "--report", str(page)]
    subprocess.run([sys.executable, "-m", "companion.cli", *words], check=True, stdout=subprocess.DEVNULL)
    browser.open(page.as_uri())
    browser.script("go(12)")
    time.sleep(2)
    shot(browser, "report.png", 0.5, 3000)


def main() -> None:
    """All of them."""
    endpoint = free_endpoint()
    port = free_tcp_port()
    with tempfile.TemporaryDirectory() as name:
        router = open_session(Endpoints(mode="router", listen=(endpoint,)))
        monitor = Monitor(port, "--connect", endpoint)
        browser = Browser(Path(name) / "profile")
        try:
            pages(browser, monitor, endpoint)
            fleet(browser, monitor, endpoint)
            report(browser, Path(name))
        finally:
            browser.close()
            monitor.close()
            router.close()


if __name__ == "__main__":
    main()
