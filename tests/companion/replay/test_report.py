"""The report of a flight, opened from the file system by a real browser that has no network."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from folder_edits import short_flight
from monitor_support import CHROMEDRIVER, CHROMIUM, Browser, decision, estimate, eventually

from companion import cli
from companion.messages.ground_cells import NO_HEIGHT, cells_of, drawable
from companion.replay.history import History
from companion.replay.report.data import verdict_spans

VIDEO = "document.getElementById('video')"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    flight = short_flight(folder / "short", seconds=3.0)
    page = folder / "short.html"
    words = ["--enable-after", "1", "--set", "decision.dwell_s=0.1"]
    assert cli.main(["replay", str(flight), "--report", str(page), *words]) == 0
    return page


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    found = Browser(tmp_path_factory.mktemp("chromium"))
    found.driver.execute_cdp_cmd("Network.enable", {})
    found.driver.execute_cdp_cmd(
        "Network.emulateNetworkConditions",
        {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0},
    )
    yield found
    found.close()


@pytest.mark.skipif(not (CHROMIUM and CHROMEDRIVER), reason="needs chromium and chromedriver")
def test_the_report_plays_and_zooms_without_network(report: Path, browser: Browser):
    browser.open(report.as_uri())
    assert eventually(lambda: browser.script(f"return {VIDEO}.readyState") >= 3)
    assert browser.script(f"return {VIDEO}.duration") == pytest.approx(3.0, abs=0.1)
    assert browser.script(f"return {VIDEO}.videoWidth") == 640
    browser.script(f"{VIDEO}.play()")
    assert eventually(lambda: browser.script(f"return {VIDEO}.currentTime") > 0.5)
    assert eventually(
        lambda: "Inclination" in browser.script("return document.getElementById('cursor').textContent")
    )
    before = browser.script("return document.getElementById('plot-inclination').toDataURL()")
    browser.script("document.querySelector('[data-zoom=in]').click()")
    assert eventually(
        lambda: browser.script("return document.getElementById('plot-inclination').toDataURL()") != before
    )
    assert browser.script("return to - from") == pytest.approx(1.5, abs=0.1)
    # a click on a plot goes to that moment in the video
    browser.script(f"{VIDEO}.pause(); acts.all(); go(2.0)")
    assert eventually(lambda: browser.script(f"return {VIDEO}.currentTime") == pytest.approx(2.0, abs=0.06))
    ink = browser.script(
        "const m = document.getElementById('map'), d = m.getContext('2d').getImageData(0, 0, m.width, m.height).data;"
        "return d.filter((v, i) => i % 4 === 3 && v > 0).length"
    )
    assert ink > 200, "the path from above"
    assert browser.errors() == []
    names = browser.script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in names if not name.startswith(("data:", "blob:"))] == []


def test_the_report_says_it_in_words_too(report: Path):
    text = report.read_text(encoding="utf-8")
    for words in (
        "A landing was requested",
        "decision.dwell_s",
        "FIT TO LAND",
        "clock settled",
        "Versions",
        "heartbeat",
    ):
        assert words in text, words
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert len(data["times"]) == 90
    assert len(data["requests"]) == 1
    assert {len(line["values"]) for plot in data["plots"] for line in plot["lines"]} == {90}


def ground(state: np.ndarray, height: np.ndarray, changes: dict | None = None) -> dict:
    def pack(values: np.ndarray) -> str:
        return base64.b64encode(values.tobytes()).decode()

    rows, columns = state.shape
    grid = {"north0_m": 1.0, "east0_m": 2.0, "cell_m": 0.1, "rows": rows, "columns": columns}
    grid |= {"state": pack(state.astype(np.uint8)), "height": pack(height.astype("<i2"))}
    return {"north_m": 0.0, "east_m": 0.0, "spots": [], "map": grid | (changes or {})}


def test_a_packed_map_comes_out_as_it_went_in():
    state = np.array([[0, 1, 2], [2, 1, 0]])
    height = np.array([[NO_HEIGHT, 10, -300], [0, 5, NO_HEIGHT]])
    found = cells_of(ground(state, height))
    assert found is not None
    assert np.array_equal(found[0], state)
    assert np.array_equal(found[1], height)
    shown = drawable(ground(state, height))
    assert shown is not None
    assert base64.b64decode(shown["map"]["state"]) == state.astype(np.uint8).tobytes()


@pytest.mark.parametrize(
    "changes",
    [
        {"rows": 3},
        {"rows": -2},
        {"rows": 10**6},
        {"state": "no base64"},
        {"height": None},
        {"columns": "3"},
        {"state": "AAAA"},
    ],
)
def test_a_map_that_does_not_fit_its_own_size_is_not_drawn(changes: dict):
    message = ground(np.ones((2, 3)), np.zeros((2, 3)), changes)
    assert cells_of(message) is None
    shown = drawable(message)
    assert shown is not None
    assert "map" not in shown


def test_every_reason_of_a_stretch_has_its_time():
    history = History()
    for frame in range(100):
        history.add(msgspec.structs.replace(estimate(frame), time_unix_us=frame * 1_000_000 // 30))
        if frame % 10 == 0:
            steep, rough = ("too_steep", "too steep"), ("too_rough", f"too rough: {frame}")
            stand = [rough] if frame < 20 else [steep] if frame < 60 else [steep, rough] if frame < 70 else []
            history.add(
                decision(
                    frame=frame,
                    verdict="unfit" if stand else "fit",
                    reasons=tuple(words for _, words in stand),
                    reason_codes=tuple(code for code, _ in stand),
                )
            )
    unfit, fit = verdict_spans(history)
    step_s = 10 / 30
    assert unfit["shares"] == [
        ["too steep", pytest.approx(5 * step_s, abs=0.05)],
        ["too rough: 0", pytest.approx(3 * step_s, abs=0.05)],
    ]
    assert [reasons for _, reasons in unfit["steps"]] == [
        ["too rough: 0"],
        ["too steep"],
        ["too steep", "too rough: 60"],
    ]
    assert fit["shares"] == []
    assert unfit["end"] == fit["start"] == pytest.approx(7 * step_s, abs=0.05)
