"""The page for everybody: accessibility in each theme, the fleet, a time to look back over, help when it is empty."""

from pathlib import Path
from typing import Any

import axe_core_python
import msgspec
import pytest
from monitor_support import (
    CHROMEDRIVER,
    CHROMIUM,
    Browser,
    Monitor,
    Vehicle,
    contrast,
    decision,
    eventually,
    health,
    show,
)
from selenium.webdriver.common.keys import Keys

pytestmark = pytest.mark.skipif(not (CHROMIUM and CHROMEDRIVER), reason="needs chromium and chromedriver")


@pytest.mark.parametrize("theme", ["light", "dark", "sunlight"])
def test_it_can_be_used_without_seeing_all_of_it(
    monitor: Monitor, browser: Browser, vehicle: Vehicle, theme: str
) -> None:
    show(browser, monitor, vehicle)
    vehicle.say(health())
    vehicle.say(decision())
    assert eventually(lambda: browser.texts()["verdict"] == "NOT FIT")
    assert eventually(
        lambda: (
            (
                browser.script(
                    "if (document.documentElement.dataset.theme !== arguments[0]) landslopeTheme()", theme
                ),
                browser.script("return document.documentElement.dataset.theme"),
            )[1]
            == theme
        )
    )
    assert grave_findings(browser) == []
    verdict = "document.querySelector('[data-field=verdict]')"
    assert browser.script(f"return {verdict}.ariaLive") == "assertive"
    assert browser.script("return document.documentElement.lang") == "en-US"
    colours = browser.script(
        f"return [getComputedStyle({verdict}).color, getComputedStyle({verdict}.parentElement).backgroundColor]"
    )
    assert contrast(*colours) >= 7


def test_the_fleet_is_sorted_by_who_needs_attention_and_its_time_can_be_looked_back(
    net: Any, monitor: Monitor, browser: Browser, vehicle: Vehicle
) -> None:
    show(browser, monitor, vehicle)
    others = [Vehicle(f"a-{name}", net.endpoint) for name in ("fit", "unfit", "silent")]
    well = msgspec.structs.replace(health(), state="ok", problems=())
    fit = decision(verdict="fit", reasons=())
    names = "return Array.from(document.querySelectorAll('.fleet-name')).map(e => e.textContent)"
    words = "return document.querySelector('[data-field=verdict]').textContent"
    try:
        for other, said in zip(others, (fit, decision(), fit), strict=True):
            other.say(well)
            other.say(said)
        vehicle.say(well)
        vehicle.say(fit)
        assert eventually(lambda: browser.script(words) == "FIT TO LAND")
        others[2].quiet.set()
        order = ["a-silent", "a-unfit", "a-fit", vehicle.bus.vehicle]
        assert eventually(lambda: [n for n in browser.script(names) if n in order] == order)
        # a fault on a fit surface is no green light
        vehicle.say(health())
        assert eventually(lambda: browser.script(words) == "FIT, WITH FAULTS")
        slider = browser.driver.find_element("css selector", ".look-back")
        slider.send_keys(Keys.ARROW_LEFT)
        assert eventually(lambda: browser.texts()["back"].startswith("5 s ago"))
        browser.script("document.getElementById('live').click()")
        assert eventually(lambda: browser.texts()["back"] == "now")
    finally:
        for other in others:
            other.close()


def test_an_empty_page_says_what_to_do(monitor: Monitor, browser: Browser) -> None:
    browser.open(f"{monitor.url}/?vehicle=nobody")
    helped = "return document.getElementById('help') && document.getElementById('help').innerText"
    assert eventually(lambda: "zenoh.connect" in (browser.script(helped) or ""))
    assert grave_findings(browser) == []


def grave_findings(browser: Browser) -> list[Any]:
    """Serious and critical findings of axe-core."""
    browser.script((Path(axe_core_python.__file__).parent / "axe.min.js").read_text(encoding="utf-8"))
    found = browser.driver.execute_async_script(
        "const done = arguments[0]; axe.run(document).then(r => done(r.violations.map("
        "v => [v.impact, v.id, v.nodes.slice(0, 3).map(n => n.html.slice(0, 200))])))"
    )
    return [finding for finding in found if finding[0] in ("serious", "critical")]
