"""A monitor in a process of its own, a real browser on it, and vehicles that speak."""

import json
import shutil
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from companion.messages.messages import (
    Decision,
    Estimate,
    Event,
    Health,
    InputHealth,
    encode,
    estimate_message,
)
from companion.messages.preview import PreviewPublisher
from companion.settings.settings import PreviewSettings
from drivers.bus import Bus, Endpoints
from drivers.samples import Frame
from landing.estimate import SurfaceEstimate, TrackView

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
]
WAIT_S = 600.0


def eventually(true: Callable[[], Any], wait_s: float = WAIT_S) -> Any:
    """The first truth within the time; False after it."""
    end = time.monotonic() + wait_s
    while time.monotonic() < end:
        found = true()
        if found:
            return found
        time.sleep(0.05)
    return False


class Monitor:
    """``landslope monitor`` on loopback."""

    def __init__(self, port: int, *words: str) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "companion.cli", "monitor", "--port", str(port), *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert eventually(self._answers), self._end()

    def rss_mb(self) -> float:
        """Resident memory."""
        for line in Path(f"/proc/{self.process.pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1024
        raise AssertionError("no VmRSS")

    def close(self) -> None:
        """End it; it must end when asked."""
        self.process.terminate()
        assert self.process.wait(WAIT_S) in (0, -15), self._end()

    def _answers(self) -> bool:
        try:
            urllib.request.urlopen(self.url, timeout=5).close()
        except urllib.error.HTTPError:
            return True
        except OSError:
            return False
        return True

    def _end(self) -> str:
        self.process.kill()
        return self.process.communicate()[0]


class Browser:
    """A headless Chromium."""

    def __init__(self, profile: Path) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM or ""
        for flag in (*FLAGS, f"--user-data-dir={profile}", "--window-size=1440,1200"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service(CHROMEDRIVER))
        self.driver.set_page_load_timeout(WAIT_S)

    def open(self, url: str) -> None:
        """Load a page and wait until it is built."""
        self.driver.get(url)
        assert eventually(lambda: self.script("return document.querySelector('main') !== null"))

    def script(self, code: str, *arguments: Any) -> Any:
        """Run JavaScript."""
        return self.driver.execute_script(code, *arguments)

    def texts(self) -> dict[str, str]:
        """All labelled fields at one instant."""
        return dict(
            self.script(
                "return Array.from(document.querySelectorAll('[data-field]'))"
                ".map(e => [e.dataset.field, e.textContent])"
            )
        )

    def alarm(self) -> str:
        """What the alarm says, empty when it is not shown."""
        return str(
            self.script(
                "const a = document.getElementById('alarm');"
                "return a && a.offsetParent !== null ? a.textContent : ''"
            )
        )

    def tilt(self) -> tuple[float, float] | None:
        """The tilt of the drawn plane: down per ahead, down per right."""
        found = self.script(
            "const s = document.querySelector('svg.scene'); return s ? [s.dataset.ahead, s.dataset.right] : null"
        )
        return (float(found[0]), float(found[1])) if found and found[0] is not None else None

    def narrow(self, width: int) -> None:
        """A phone's screen."""
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 844, "deviceScaleFactor": 2, "mobile": True},
        )

    def wide(self) -> None:
        """A desk's screen."""
        self.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})

    def errors(self) -> list[str]:
        """What the browser's console complained of since the last call."""
        return [e["message"] for e in self.driver.get_log("browser") if e["level"] == "SEVERE"]

    def close(self) -> None:
        """Quit."""
        self.driver.quit()


def surface(number: int, inclination_deg: float = 12.5) -> SurfaceEstimate:
    """An estimate whose surface rises ahead by its inclination."""
    spots = np.array([[100.0, 60.0], [200.0, 120.0], [50.0, 200.0]])
    return SurfaceEstimate(
        frame=number,
        time_s=number / 30,
        status="ok",
        method="map",
        ventral_flow_x=0.25,
        ventral_flow_y=-0.5,
        time_to_contact_s=8.25,
        roll_deg=1.0,
        pitch_deg=-2.0,
        surface_pitch_deg=inclination_deg,
        surface_roll_deg=0.0,
        inclination_deg=inclination_deg,
        inclination_std_deg=0.25,
        downhill_bearing_deg=181.0,
        roughness=0.0123,
        roughness_std=0.002,
        features=3,
        tracks=TrackView(
            previous_px=spots,
            current_px=spots + 5,
            inlier=np.array([True, True, False]),
            height=np.zeros(3),
        ),
    )


def estimate(number: int, inclination_deg: float = 12.5) -> Estimate:
    """Its message, stamped now."""
    return estimate_message(surface(number, inclination_deg), time.time_ns() // 1000, None, True)


def decision(**changes: Any) -> Decision:
    """A decision that withholds."""
    given: dict[str, Any] = {
        "frame": 1,
        "time_unix_us": 1,
        "verdict": "unfit",
        "reasons": ("too steep: 12.5 degrees, limit 10.0",),
        "since_unix_us": 1,
        "permitted": False,
        "withheld": ("landing is not enabled",),
        "requested": False,
        "command": "none",
    }
    return Decision(**{**given, **changes})


def health() -> Health:
    """One input that is well, one that is not."""
    return Health(
        time_unix_us=1,
        state="degraded",
        problems=("gyro: stale for 2.5 s",),
        mode="GUIDED",
        armed=True,
        recording=True,
        inputs={
            "frames": InputHealth(state="ok", count=900, refused=2, rate_hz=29.97, age_s=0.03),
            "gyro": InputHealth(state="stale", count=10, refused=0, rate_hz=None, age_s=2.5),
        },
        counters={"estimates ok": 880},
        clock_offset_s=1.0,
        clock_std_s=0.0006,
        camera_late_s=0.0121,
        camera_late_std_s=0.0008,
        pipeline_ms=7.5,
    )


def event(text: str) -> Event:
    """Something that happened."""
    return Event(event="test", frame=None, time_unix_us=time.time_ns() // 1000, severity="info", text=text)


class Vehicle:
    """A vehicle that publishes on its own, until it is quiet."""

    def __init__(self, name: str, endpoint: str, period_s: float = 0.1) -> None:
        self.bus = Bus(name, Endpoints(mode="client", connect=(endpoint,)), retry=True)
        self.preview = PreviewPublisher(self.bus, PreviewSettings())
        self.number = 0
        self.inclination_deg = 12.5
        self.quiet = threading.Event()
        self._period_s = period_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def say(self, message: Estimate | Decision | Health | Event) -> None:
        """Publish one message."""
        self.bus.put(type(message).__name__.lower(), encode(message))

    def close(self) -> None:
        """Leave."""
        self._stop.set()
        self._thread.join()
        self.preview.close()
        self.bus.close()

    def _run(self) -> None:
        image = np.tile(np.arange(320, dtype=np.uint16) % 256, (240, 1)).astype(np.uint8)
        while not self._stop.wait(self._period_s):
            if self.quiet.is_set():
                continue
            self.number += 1
            self.say(estimate(self.number, self.inclination_deg))
            now_us = time.time_ns() // 1000
            frame = Frame(number=self.number, stamp_us=now_us, arrival_us=now_us, image=image)
            self.preview.put(frame, surface(self.number), now_us)


def received_json(lines: list[bytes]) -> dict[int, dict[str, Any]]:
    """Estimates by frame."""
    return {found["frame"]: found for found in map(json.loads, lines)}


def show(browser: Browser, monitor: Monitor, vehicle: Vehicle) -> None:
    """Open the page of a vehicle and wait until it is there."""
    browser.open(f"{monitor.url}/?vehicle={vehicle.bus.vehicle}")
    assert eventually(lambda: browser.texts().get("inclination_deg", "–") != "–")


def contrast(*colours: str) -> float:
    """Contrast ratio of two CSS colours, after WCAG 2."""
    light = []
    for colour in colours:
        channels = [int(part) / 255 for part in colour.split("(")[1].rstrip(")").split(",")[:3]]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
        light.append(0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2])
    return (max(light) + 0.05) / (min(light) + 0.05)
