"""What previews cost the pipeline, unwatched and watched: ``python -m companion.benchmark.preview_cost``."""

import statistics
import time
from dataclasses import dataclass

import numpy as np

from companion.fleet.fleet import free_endpoint
from companion.messages.preview import PreviewPublisher
from companion.settings.settings import PreviewSettings
from drivers.bus import Bus, Endpoints, Subscription
from drivers.samples import Frame
from landing.estimate import SurfaceEstimate, TrackView

TRACKS = 150
PICTURES = 100
UNWATCHED_CALLS = 2000
WAIT_S = 10.0
SIZES = ((160, 120), (320, 240), (640, 480), (1280, 960))


@dataclass(frozen=True, slots=True)
class PreviewCost:
    """Medians of one image size. ``core_share`` is of one core, at the settings' rate."""

    width: int
    height: int
    unwatched_us: float
    picture_ms: float
    core_share: float
    jpeg_bytes: int


def measure(width: int, height: int, settings: PreviewSettings | None = None) -> PreviewCost:
    """The time of ``PreviewPublisher.put`` on noise, the hardest picture to compress."""
    chosen = settings or PreviewSettings()
    endpoint = free_endpoint()
    noise = np.random.default_rng(1)
    image = noise.integers(0, 256, (height, width), dtype=np.uint8)
    spots = noise.uniform(0, (width, height), (TRACKS, 2))
    tracks = TrackView(spots, spots + 3.0, np.ones(TRACKS, bool), np.zeros(TRACKS))
    estimate = SurfaceEstimate(frame=0, time_s=0.0, status="ok", method="map", tracks=tracks)
    period_us = round(1e6 / chosen.rate_hz)

    def cost_of(publisher: PreviewPublisher, calls: int) -> float:
        taken = []
        for number in range(calls):
            frame = Frame(number, number * period_us, number * period_us, image)
            start = time.perf_counter()
            publisher.put(frame, estimate, 0)
            taken.append(time.perf_counter() - start)
        return statistics.median(taken)

    with Bus("preview-cost", Endpoints(listen=(endpoint,))) as bus:
        publisher = PreviewPublisher(bus, chosen)
        unwatched_s = cost_of(publisher, UNWATCHED_CALLS)
        with Subscription(Endpoints(connect=(endpoint,)), "preview-cost", ("preview",)) as watcher:
            end = time.monotonic() + WAIT_S
            while not publisher.watched and time.monotonic() < end:
                time.sleep(0.01)
            picture_s = cost_of(publisher, PICTURES)
            size = 0
            while (delivery := watcher.receive(0.2)) is not None:
                size = max(size, len(delivery.payload))
        publisher.close()
    return PreviewCost(width, height, unwatched_s * 1e6, picture_s * 1e3, picture_s * chosen.rate_hz, size)


def lines(found: list[PreviewCost]) -> list[str]:
    """For people."""
    found_lines = ["image        unwatched    one picture   of one core   JPEG"]
    for c in found:
        share, size_kb = 100 * c.core_share, c.jpeg_bytes / 1000
        size = f"{c.width:>4} x {c.height:<4}"
        found_lines.append(
            f"{size}  {c.unwatched_us:6.2f} us    {c.picture_ms:7.2f} ms   {share:8.2f} %   {size_kb:4.0f} kB"
        )
    return found_lines


if __name__ == "__main__":
    print("\n".join(lines([measure(*size) for size in SIZES])))
