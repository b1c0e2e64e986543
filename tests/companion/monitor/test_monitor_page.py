"""The live page in a real browser, fed by a real router: values, alarm, plane, phone, bursts, outages."""

import json
import subprocess
import sys
import time
from typing import Any

import pytest
from monitor_support import (
    CHROMEDRIVER,
    CHROMIUM,
    Browser,
    Monitor,
    Vehicle,
    contrast,
    decision,
    estimate,
    event,
    eventually,
    health,
    show,
)
from places import REPOSITORY

from drivers.bus import Endpoints, Subscription

pytestmark = pytest.mark.skipif(not (CHROMIUM and CHROMEDRIVER), reason="needs chromium and chromedriver")
FLIGHT = REPOSITORY / "sitl_logs" / "stairs_a"
BURST = 10_000
MANY = 25
STAIRS = 0.4
"""Fall ahead of the stairs, as the tangent, and something less."""


def shown_frame(browser: Browser) -> int:
    words = browser.texts().get("frame", "").split()
    return int(words[1].rstrip(":")) if len(words) > 1 else 0


def spread(message: dict[str, Any], value: str, std: str, digits: int, unit: str) -> str:
    """What the page must say of a value and its standard deviation."""
    if message[value] is None:
        return "–"
    if message[std] is None:
        return f"{message[value]:.{digits}f}{unit}"
    return f"{message[value]:.{digits}f} ± {message[std]:.{digits}f}{unit}"


def test_a_live_replay_is_shown_as_it_was_published(net: Any, monitor: Monitor, browser: Browser) -> None:
    published: dict[int, dict[str, Any]] = {}
    seen: dict[int, tuple[dict[str, str], tuple[float, float] | None]] = {}
    settings = ("zenoh.mode=client", f"zenoh.connect={net.endpoint}", "vehicle.name=replayed")
    words = [word for setting in settings for word in ("--set", setting)]
    command = [
        sys.executable,
        "-m",
        "companion.cli",
        "replay",
        str(FLIGHT),
        "--realtime",
        "--publish",
        *words,
    ]
    with Subscription(
        Endpoints(mode="client", connect=(net.endpoint,)), "replayed", ("estimate",)
    ) as all_of_it:
        browser.open(f"{monitor.url}/?vehicle=replayed")
        replay = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            while replay.poll() is None:
                texts, tilt = browser.texts(), browser.tilt()
                if texts.get("frame"):
                    seen[int(texts["frame"].split()[1].rstrip(":"))] = (texts, tilt)
                if len(seen) > MANY and tilt is not None and tilt[0] > STAIRS:
                    break
                time.sleep(0.2)
        finally:
            replay.kill()
            replay.wait()
        while (delivery := all_of_it.receive(0.5)) is not None:
            if delivery.alive is None:
                message = json.loads(delivery.payload)
                published[message["frame"]] = message
    assert len(seen) > MANY
    # Publishers drop rather than wait: on a crowded machine the two subscribers may lack different frames.
    both = seen.keys() & published.keys()
    assert len(both) > MANY / 2
    for frame in both:
        texts, message = seen[frame][0], published[frame]
        assert message["status"].replace("_", " ") in texts["frame"]
        assert texts["inclination_deg"] == spread(message, "inclination_deg", "inclination_std_deg", 1, "°")
        assert texts["roughness"] == spread(message, "roughness", "roughness_std", 4, "")
        flow = (message["ventral_flow_x"], message["ventral_flow_y"])
        assert texts["ventral_flow"] == ("–" if None in flow else f"{flow[0]:+.2f}, {flow[1]:+.2f}")
    assert any(published[frame]["inclination_deg"] is not None for frame in both)
    # The flight goes over level ground, then down stairs of 30 degrees: the plane follows.
    assert max(tilt[0] for _, tilt in seen.values() if tilt) > STAIRS
    assert min(abs(tilt[0]) for _, tilt in seen.values() if tilt) < 0.05
    # The replay was ended: the vehicle has left, and the page says so.
    assert eventually(lambda: "replayed IS SILENT" in browser.alarm())
    assert not browser.errors()


def test_every_part_of_the_page_says_what_the_messages_say(
    monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    show(browser, monitor, vehicle)
    vehicle.say(decision(command="accepted", verdict="unfit"))
    vehicle.say(health())
    vehicle.say(event("surface unfit <b>bold</b>"))
    assert eventually(lambda: "accepted" in browser.texts().get("command", ""))
    assert eventually(lambda: "bold" in browser.texts().get("events", ""))
    texts = browser.texts()
    assert texts["verdict"] == "NOT FIT"
    assert texts["against"] == "too steep: 12.5 degrees, limit 10.0"
    assert texts["inclination_deg"] == "12.5 ± 0.2°"
    assert texts["time_to_contact_s"] == "8.2 s"
    assert texts["ventral_flow"] == "+0.25, -0.50"
    assert texts["roughness"] == "0.0123 ± 0.0020"
    assert texts["slopes"] == "rises 12.5° ahead, rises 0.0° to the right"
    assert texts["downhill_bearing_deg"] == "south (181°)"
    assert texts["attitude"] == "roll 1° right, nose 2° down"
    assert (texts["armed"], texts["mode"]) == ("ARMED", "GUIDED")
    assert texts["status"] == "camera calibratedgyro stalerecording"
    assert texts["permission"] == "withheld: landing is not enabled"
    assert texts["health"] == "degraded"
    assert texts["problems"] == "gyro: stale for 2.5 s"
    assert "clocks agree to 0.6 ms; frames 12 ms later than set" in texts["clock"]
    inputs = browser.script("return document.getElementById('inputs').innerText").split("\n")
    assert inputs == ["frames: ok", "30.0 Hz", "0.03 s", "900, 2 refused", "gyro: stale", "–", "2.50 s", "10"]
    # Texts of a vehicle are texts, whatever is in them.
    assert "<b>bold</b>" in texts["events"]
    assert browser.script("return document.querySelectorAll('.page b').length") == 0
    assert not browser.errors()


def test_the_plane_tilts_with_the_surface(monitor: Monitor, browser: Browser, vehicle: Vehicle) -> None:
    def drawn() -> str:
        return str(
            browser.script("return document.querySelectorAll('svg.scene polygon')[1].getAttribute('points')")
        )

    show(browser, monitor, vehicle)
    vehicle.inclination_deg = 0.0
    assert eventually(lambda: browser.tilt() == (0.0, 0.0))
    level = drawn()
    vehicle.inclination_deg = 20.0
    # Rising ahead: the surface's depth shrinks ahead by tan 20 degrees.
    assert eventually(lambda: browser.tilt() == (-0.364, 0.0))
    assert drawn() != level


def test_pictures_come_while_somebody_looks_and_only_then(
    monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    show(browser, monitor, vehicle)
    image = "document.querySelector('#preview img')"
    assert eventually(lambda: browser.script(f"return {image} && {image}.naturalWidth") == 320)
    assert eventually(lambda: "2 inliers, 1 outliers" in browser.texts().get("preview", ""))
    assert browser.script("return document.querySelectorAll('#preview .overlay svg circle').length") == 2
    assert vehicle.preview.watched
    first = browser.script(f"return {image}.src")
    assert first.startswith("data:image/jpeg")
    browser.driver.get("about:blank")
    assert eventually(lambda: not vehicle.preview.watched)
    published = vehicle.preview.published
    time.sleep(0.5)
    assert vehicle.preview.published == published


def test_the_alarm_comes_when_a_vehicle_stops_and_goes_when_it_returns(
    net: Any, monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    show(browser, monitor, vehicle)
    vehicle.say(decision(verdict="unfit"))
    silent = f"{vehicle.bus.vehicle} IS SILENT"
    assert eventually(lambda: silent not in browser.alarm())
    faded = "return getComputedStyle(document.querySelector('.page > section.card:not(.help)')).opacity"
    vehicle.quiet.set()  # the process lives, its messages stop
    assert eventually(lambda: silent in browser.alarm())
    assert eventually(lambda: float(browser.script(faded)) < 0.5)  # what it said last is not true any more
    assert browser.texts()["verdict"] == "SILENT"
    assert "they may be out of date" in browser.texts()["against"]
    vehicle.quiet.clear()
    assert eventually(lambda: silent not in browser.alarm())
    assert eventually(lambda: float(browser.script(faded)) == 1)
    assert browser.texts()["verdict"] == "NOT FIT"
    vehicle.close()  # the process ends
    assert eventually(lambda: silent in browser.alarm())
    browser.script("document.getElementById('dismiss').click()")
    assert eventually(lambda: silent not in browser.alarm())
    back = Vehicle(vehicle.bus.vehicle, net.endpoint)
    try:
        assert eventually(lambda: float(browser.script(faded)) == 1)
        assert silent not in browser.alarm()
        back.quiet.set()  # a silence that begins anew is shown again
        assert eventually(lambda: silent in browser.alarm())
    finally:
        back.close()


def test_the_router_goes_away_and_comes_back(
    net: Any, monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    show(browser, monitor, vehicle)
    net.go()
    assert eventually(lambda: "NO CONNECTION" in browser.alarm())
    assert eventually(lambda: f"{vehicle.bus.vehicle} IS SILENT" in browser.alarm())
    net.come_back()
    assert eventually(lambda: "NO CONNECTION" not in browser.alarm())
    assert eventually(lambda: f"{vehicle.bus.vehicle} IS SILENT" not in browser.alarm())
    number = vehicle.number
    assert eventually(lambda: shown_frame(browser) > number)


def test_bursts_leave_the_page_live_and_its_memory_bounded(
    monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    show(browser, monitor, vehicle)
    vehicle.quiet.set()
    sizes = []
    for round_ in range(1, 4):
        for number in range(BURST):
            vehicle.say(estimate(round_ * 1_000_000 + number))
            if number % 20 == 0:
                vehicle.say(event(f"event {number} " + "x" * 200))
        last = round_ * 1_000_000 + BURST
        assert eventually(lambda last=last: (vehicle.say(estimate(last)), shown_frame(browser) == last)[1])
        sizes.append(monitor.rss_mb())
    # The first burst may fill queues and pools; what follows must not add up.
    assert sizes[2] - sizes[0] < 25, sizes
    assert len(browser.texts()["events"].split("\n")) <= 7
    vehicle.quiet.clear()
    vehicle.number = 9_000_000
    assert eventually(lambda: shown_frame(browser) > 9_000_000)


def test_a_phone_shows_it_without_scrolling_sideways(
    net: Any, monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    other = Vehicle("w" * 60, net.endpoint)
    try:
        show(browser, monitor, vehicle)
        vehicle.say(decision(reasons=("unbroken" * 30,), withheld=("reason " * 40,)))
        vehicle.say(health())
        vehicle.say(event("e" * 500))
        assert eventually(lambda: "unbroken" in browser.texts().get("against", ""))
        assert eventually(lambda: "eee" in browser.texts().get("events", ""))
        browser.narrow(390)
        assert eventually(lambda: browser.script("return innerWidth") == 390)
        assert eventually(lambda: browser.script("return document.documentElement.scrollWidth") <= 390)
        cut = browser.script(
            "return Array.from(document.querySelectorAll('.page *, .top *')).filter(e => !e.closest('svg') &&"
            " e.getBoundingClientRect().right > 390.5).map(e => e.className)"
        )
        assert cut == []
        sizes = browser.script(
            "return Array.from(document.querySelectorAll('[data-field]')).map(e =>"
            " parseFloat(getComputedStyle(e).fontSize))"
        )
        assert min(sizes) >= 16
        verdict = "document.querySelector('[data-field=verdict]')"
        # However far one has scrolled, the verdict is in view.
        browser.script("window.scrollTo(0, 1500)")
        assert eventually(lambda: browser.script("return scrollY") > 1000)
        assert 0 <= browser.script(f"return {verdict}.getBoundingClientRect().top") < 400
        assert browser.script(f"return parseFloat(getComputedStyle({verdict}).fontSize)") >= 32
        # In sunlight contrast is what counts: 7 to 1 is the strictest level of the accessibility guidelines.
        colours = browser.script(
            f"return [getComputedStyle({verdict}).color, getComputedStyle({verdict}.parentElement).backgroundColor]"
        )
        assert contrast(*colours) > 6.9
    finally:
        browser.wide()
        other.close()


def test_nothing_is_fetched_from_elsewhere(monitor: Monitor, browser: Browser, vehicle: Vehicle) -> None:
    show(browser, monitor, vehicle)
    names = browser.script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert len(names) > 5
    assert [n for n in names if not n.startswith((monitor.url, "data:"))] == []
