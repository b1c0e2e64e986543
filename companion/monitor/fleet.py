"""The fleet view of the page: one card per vehicle, those that need attention first.

In: the ``Watch`` with the newest messages of every vehicle, and the monotonic time in s. Out: a ``View`` for one
refresh of the page, and the HTML of a card.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from html import escape

from companion.messages.messages import Event
from companion.monitor import words
from companion.monitor.state import Vehicle, Watch

LONGEST_REASON = 90


@dataclass(frozen=True, slots=True)
class Card:
    """One vehicle in the fleet view; a lower ``rank`` needs attention sooner.

    ``look``: CSS class of the verdict; ``sign`` and ``word``: the verdict as symbol and text; ``reason``: the first
    reason against a landing; ``age``: time since the newest message, as text; ``battery``: as text, empty if unknown.
    """

    rank: int
    name: str
    look: str
    sign: str
    word: str
    reason: str
    age: str
    battery: str


def card_of(vehicle: Vehicle, silent: bool, now_s: float) -> Card:
    """What the fleet view shows of a vehicle."""
    decision, health = vehicle.decision, vehicle.health
    look = "unknown" if silent else words.look(decision, health, vehicle.estimate)
    word = words.SILENT if silent else words.verdict(decision, health, vehicle.estimate)
    against = words.against(decision, vehicle.estimate, health)
    reason = against[0] if against else "nothing against it"
    if silent:
        reason = "last: " + words.verdict(decision, health, vehicle.estimate)
    heard = vehicle.heard_s
    age = "not heard yet" if heard is None else f"{words.duration(max(0.0, now_s - heard))} ago"
    return Card(
        rank=_rank(vehicle, silent, look),
        name=vehicle.name,
        look="silent" if silent else look,
        sign=words.SIGNS["silent" if silent else look],
        word=word,
        reason=reason[:LONGEST_REASON],
        age=age,
        battery=words.battery(health),
    )


def in_order(cards: Iterable[Card]) -> list[Card]:
    """By rank, then by name."""
    return sorted(cards, key=lambda card: (card.rank, card.name))


@dataclass(frozen=True, slots=True)
class View:
    """What one refresh shows, copied under one lock. ``silent``: names, seconds; ``events`` of ``vehicle``."""

    cards: list[Card]
    vehicle: Vehicle | None
    silent: list[tuple[str, float]]
    events: list[Event]


def view_of(watch: Watch, chosen: str | None, now_s: float) -> View:
    """The state of all vehicles; while none is chosen, the first one that is not silent is shown."""
    watch.tick(now_s)
    with watch.lock:
        vehicles = sorted(watch.vehicles.values(), key=lambda v: v.name)
        cards = in_order(card_of(v, watch.is_silent(v, now_s), now_s) for v in vehicles)
        silent = [(v.name, now_s - v.silent_since_s) for v in vehicles if v.silent_since_s is not None]
        vehicle = watch.vehicles.get(chosen) if chosen else None
        if vehicle is None and chosen is None and vehicles:
            vehicle = next((v for v in vehicles if not watch.is_silent(v, now_s)), vehicles[0])
        return View(cards, vehicle, silent, list(vehicle.events) if vehicle else [])


def card_html(card: Card) -> str:
    """The inside of a card's button; every text of a vehicle is escaped."""
    battery = f'<span class="fleet-age">{escape(card.battery)}</span>' if card.battery else ""
    return (
        f'<span class="sign is-{card.look}" aria-hidden="true">{card.sign}</span>'
        f'<span class="fleet-name">{escape(words.clipped(card.name))}</span>'
        f'<span class="fleet-word">{escape(words.clipped(card.word))}</span>'
        f'<span class="fleet-reason">{escape(card.reason)}</span>'
        f'<span class="fleet-age">{escape(card.age)}</span>{battery}'
    )


def _rank(vehicle: Vehicle, silent: bool, look: str) -> int:
    """0 silent, 1 broken, 2 landing on what is not fit, 3 not fit, 4 degraded, 5 unknown, 6 all well."""
    decision, health = vehicle.decision, vehicle.health
    state = "ok" if health is None else health.state
    landing = decision is not None and decision.requested
    if silent:
        return 0
    if state == "failed":
        return 1
    if landing and look != "fit":
        return 2
    if look == "unfit":
        return 3
    if look == "caution" or state != "ok":
        return 4
    return 5 if look == "unknown" else 6
