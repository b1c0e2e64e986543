"""Previews over a real bus: only while watched, at most so often, small, and never in the pipeline's way."""

from collections.abc import Iterator
from itertools import pairwise

import cv2
import msgspec
import numpy as np
import pytest
from monitor_support import eventually, surface
from ports import free_endpoint

from companion.benchmark.preview_cost import lines, measure
from companion.messages.preview import Preview, PreviewPublisher, jpeg, overlay
from companion.settings.settings import PreviewSettings
from drivers.bus import Bus, Delivery, Endpoints, Subscription
from drivers.samples import Frame
from landing.estimate import SurfaceEstimate, TrackView

PERIOD_US = 200_000


def frame(number: int, arrival_us: int, width: int = 320, height: int = 240) -> Frame:
    image = np.full((height, width), number % 256, np.uint8)
    return Frame(number=number, stamp_us=arrival_us, arrival_us=arrival_us, image=image)


@pytest.fixture
def bus() -> Iterator[tuple[Bus, str]]:
    endpoint = free_endpoint()
    with Bus("vehicle1", Endpoints(listen=(endpoint,))) as found:
        yield found, endpoint


@pytest.fixture
def watched(bus: tuple[Bus, str]) -> Iterator[tuple[PreviewPublisher, Subscription]]:
    publisher = PreviewPublisher(bus[0], PreviewSettings())
    with Subscription(Endpoints(connect=(bus[1],)), "vehicle1", ("preview",)) as watcher:
        assert eventually(lambda: publisher.watched)
        yield publisher, watcher
    publisher.close()


def pictures(watcher: Subscription) -> list[Delivery]:
    found = []
    while (delivery := watcher.receive(0.5)) is not None:
        if delivery.topic == "preview":
            found.append(delivery)
    return found


def test_nothing_is_made_while_nobody_subscribes(bus: tuple[Bus, str]) -> None:
    publisher = PreviewPublisher(bus[0], PreviewSettings())
    assert not any(publisher.put(frame(n, n * PERIOD_US), surface(n), 0) for n in range(100))
    assert publisher.published == 0
    with Subscription(Endpoints(connect=(bus[1],)), "vehicle1", ("preview",)):
        assert eventually(lambda: publisher.watched)
        assert publisher.put(frame(1, 0), surface(1), 0)
    assert eventually(lambda: not publisher.watched)
    assert not publisher.put(frame(2, 10**9), surface(2), 0)
    publisher.close()


def test_the_picture_and_its_overlay_arrive_together(
    watched: tuple[PreviewPublisher, Subscription],
) -> None:
    publisher, watcher = watched
    publisher.put(frame(9, 0, 640, 480), surface(9), 1234)
    (delivery,) = pictures(watcher)
    drawn = msgspec.json.decode(delivery.attachment, type=Preview)
    assert (drawn.frame, drawn.time_unix_us, drawn.width, drawn.height) == (9, 1234, 640, 480)
    assert drawn.tracks[0] == (100.0, 60.0, 105.0, 65.0)
    assert drawn.inlier == (True, True, False)
    image = cv2.imdecode(np.frombuffer(delivery.payload, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape == (240, 320)
    assert abs(int(image[100, 100]) - 9) <= 2


def test_at_most_five_a_second_of_the_frames_own_time(
    watched: tuple[PreviewPublisher, Subscription],
) -> None:
    publisher, _ = watched
    times = [n * 1_000_000 // 30 for n in range(300)]  # ten seconds at 30 Hz
    made = [t for n, t in enumerate(times) if publisher.put(frame(n, t), surface(n), 0)]
    assert len(made) == 50
    assert min(b - a for a, b in pairwise(made)) >= PERIOD_US - 34_000


def test_a_clock_that_jumps_does_not_stop_them(watched: tuple[PreviewPublisher, Subscription]) -> None:
    publisher, _ = watched
    assert publisher.put(frame(1, 10**12), surface(1), 0)
    assert publisher.put(frame(2, 0), surface(2), 0)  # set back
    assert not publisher.put(frame(3, 1000), surface(3), 0)
    assert publisher.put(frame(4, 10**13), surface(4), 0)  # set forward
    assert not publisher.put(frame(5, 10**13 + 1000), surface(5), 0)


def test_a_closed_bus_costs_a_picture_not_the_flight(
    bus: tuple[Bus, str], watched: tuple[PreviewPublisher, Subscription]
) -> None:
    publisher, _ = watched
    bus[0].close()
    publisher.watched = True
    assert not publisher.put(frame(1, 0), surface(1), 0)
    assert publisher.unsent == 1


def test_a_router_that_is_not_there_yet_is_no_hindrance() -> None:
    with Bus("vehicle1", Endpoints(mode="client", connect=(free_endpoint(),)), retry=True) as waiting:
        publisher = PreviewPublisher(waiting, PreviewSettings())
        assert not publisher.put(frame(1, 0), surface(1), 0)
        publisher.close()


def test_tracks_are_thinned_evenly_and_broken_ones_left_out() -> None:
    spots = np.column_stack([np.arange(1000.0), np.arange(1000.0)])
    spots[0] = np.nan
    tracks = TrackView(spots, spots, np.ones(1000, bool), np.zeros(1000))
    estimate = SurfaceEstimate(frame=1, time_s=0.0, status="ok", method="map", tracks=tracks)
    drawn = overlay(frame(1, 0), estimate, 0, 150)
    assert 140 <= len(drawn.tracks) <= 150
    assert len(drawn.inlier) == len(drawn.tracks)
    assert drawn.tracks[-1][0] > 990
    nothing = overlay(
        frame(1, 0), SurfaceEstimate(frame=1, time_s=0.0, status="starting", method="map"), 0, 9
    )
    assert nothing.tracks == ()


def test_small_pictures_are_not_enlarged() -> None:
    image = cv2.imdecode(np.frombuffer(jpeg(np.zeros((120, 160), np.uint8), 320, 70), np.uint8), 0)
    assert image is not None
    assert image.shape == (120, 160)


def test_the_cost_is_measured_on_what_really_goes_out() -> None:
    cost = measure(160, 120)
    assert cost.jpeg_bytes > 3000
    assert cost.picture_ms * 1000 > cost.unwatched_us > 0
    assert "160 x 120" in lines([cost])[1]
