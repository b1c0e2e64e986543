"""Between the drivers' threads and the pipeline's: nothing waits, nothing is lost in silence."""

import threading

from companion.live.inbox import Inbox
from drivers.events import DriverEvent
from drivers.samples import LandedState


def sample(number: int) -> LandedState:
    return LandedState(number, "in_air")


def test_what_was_put_comes_out_once_in_order() -> None:
    inbox = Inbox()
    inbox.put([sample(1), sample(2)])
    inbox.report(DriverEvent("e", "info", "", 0))
    samples, events = inbox.take(0)
    assert ([s.arrival_us for s in samples], [e.event for e in events]) == ([1, 2], ["e"])
    assert inbox.take(0) == ([], [])


def test_what_does_not_fit_pushes_out_the_oldest_and_is_counted() -> None:
    inbox = Inbox(capacity=3)
    inbox.put(sample(i) for i in range(5))
    assert [s.arrival_us for s in inbox.take(0)[0]] == [2, 3, 4]
    assert inbox.dropped == 2


def test_gathering_ends_at_once_when_something_urgent_comes() -> None:
    inbox = Inbox()
    inbox.put([sample(1)])
    threading.Timer(0.1, inbox.wake).start()
    taken: list[int] = []
    taker = threading.Thread(target=lambda: taken.append(len(inbox.take(10, gather_s=3600)[0])), daemon=True)
    taker.start()
    taker.join(30)  # without the wake it takes an hour
    assert taken == [1]


def test_gathered_samples_are_not_left_behind() -> None:
    inbox = Inbox()
    inbox.put([sample(1)])
    threading.Timer(0.05, inbox.put, ([sample(2)],)).start()
    assert len(inbox.take(10, gather_s=0.5)[0]) == 2
