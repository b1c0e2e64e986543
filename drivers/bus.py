"""The zenoh bus: a vehicle's messages go out, a watcher's come in. Nothing here takes a command.

A publisher declares three things beside its messages: the liveliness token ``landslope/<vehicle>/alive``
and read-only queryables that answer with the newest ``configuration`` and ``decision``. Congestion control
is DROP throughout: with BLOCK a slow subscriber stalls the publisher for seconds. Decisions and events have
a queue of their own (a higher priority), so that a burst of estimates cannot push them out, and room in it.
"""

import contextlib
import json
import logging
import queue
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from drivers.errors import DriverError
from drivers.system.hanging import HangingThread

log = logging.getLogger(__name__)

ROOT = "landslope"
ALIVE = "alive"
CONFIGURATION = "configuration"
DECISION = "decision"
IMPORTANT = frozenset({DECISION, "event"})
CONNECT_TIMEOUT_MS = 2000
IMPORTANT_BATCHES = 16
"""Room for decisions and events in batches of 64 kB, the most that zenoh takes. By default it has two, and some hundred
messages put while its threads have no processor are too many."""
RETRY_S = 1.0
FIRST_TRY_S = 0.2
"""How long a publisher that may go on without a session waits for it: a router that is there answers sooner."""
LEAVE_S = 0.7
"""How long the end of a session is waited for: with a router that hangs it takes zenoh many seconds."""
QUEUE_LENGTH = 10_000


@dataclass(frozen=True, slots=True)
class Endpoints:
    """How a session finds the others. ``connect`` and ``listen`` are zenoh endpoints ("tcp/10.0.0.2:7447").

    Without scouting nothing is searched for, and nothing is listened on but ``listen``. ``config_file`` is a
    zenoh configuration (JSON5) to start from: TLS, access control.
    """

    mode: str = "peer"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    scouting: bool = False
    config_file: str = ""

    @property
    def isolated(self) -> bool:
        """Whether nobody could ever be reached."""
        return not (self.connect or self.listen or self.scouting or self.config_file)


@dataclass(frozen=True, slots=True)
class Delivery:
    """What a watcher receives: a message (``alive`` None), or a vehicle that came (True) or fell silent (False)."""

    vehicle: str
    topic: str
    payload: bytes = b""
    alive: bool | None = None
    attachment: bytes = b""


def open_session(endpoints: Endpoints) -> zenoh.Session:
    """A zenoh session. Raises DriverError when the settings are wrong or, as a client, no router answers."""
    try:
        return zenoh.open(_config(endpoints))
    except zenoh.ZError as error:
        reached = ", ".join(endpoints.connect) or "any router"
        raise DriverError(
            f"zenoh: no session as {endpoints.mode} with {reached}: {_brief(error)}; "
            "check zenoh.connect, zenoh.listen and that the router runs"
        ) from None


class Bus:
    """A vehicle's side: publishes, answers two questions, and is alive as long as it is open.

    With ``retry`` the session is opened in the background, again and again while the router is absent; without, that
    is a DriverError. Messages put in the meantime are counted in ``unsent``. Wrong settings are a DriverError always.
    """

    def __init__(self, vehicle: str, endpoints: Endpoints, *, retry: bool = False) -> None:
        if not vehicle or any(c in vehicle for c in "/*$?# "):
            raise DriverError(
                f"vehicle name '{vehicle}' cannot be part of a key: use letters, digits, - and _"
            )
        self.vehicle = vehicle
        self.unsent = 0
        self._endpoints = endpoints
        self._answers: dict[str, bytes] = {}
        self._publishers: dict[str, Any] = {}
        self._declared: list[Any] = []
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._session: zenoh.Session | None = None
        if retry:
            _config(endpoints)
            opener = HangingThread(target=self._keep_trying, name="zenoh-open")
            opener.start()
            opener.join(FIRST_TRY_S)
        else:
            self._adopt(open_session(endpoints))

    @property
    def session(self) -> zenoh.Session | None:
        """The session; None as long as no router has answered."""
        return self._session

    def key(self, topic: str) -> str:
        """``landslope/<vehicle>/<topic>``."""
        return f"{ROOT}/{self.vehicle}/{topic}"

    def put(self, topic: str, payload: bytes) -> None:
        """Publish one JSON message; never waits for a subscriber."""
        if topic in (CONFIGURATION, DECISION):
            self._answers[topic] = payload
        with self._lock:
            if self._session is None:
                self.unsent += 1
                return
            try:
                self._publisher(topic).put(payload)
            except zenoh.ZError:
                self.unsent += 1

    def answer(self, topic: str, payload: bytes) -> None:
        """What the queryable ``configuration`` or ``decision`` answers from now on."""
        self._answers[topic] = payload

    def subscribed(self, topic: str) -> bool:
        """Whether somebody subscribes to the topic now."""
        with self._lock:
            return self._session is not None and bool(self._publisher(topic).matching_status.matching)

    def close(self) -> None:
        """Leave the bus: the token goes, watchers see the vehicle as silent. Not waited for longer than LEAVE_S."""
        self._closing.set()
        leaver = HangingThread(target=self._leave, name="zenoh-close")
        leaver.start()
        leaver.join(LEAVE_S)

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _leave(self) -> None:
        with self._lock:
            session, self._session = self._session, None
            entities = (*self._publishers.values(), *self._declared)
            self._publishers.clear()
            self._declared.clear()
        with contextlib.suppress(zenoh.ZError):  # whatever is wrong with it now, it is being left
            for entity in entities:
                entity.undeclare()
            if session is not None:
                session.close()

    def _adopt(self, session: zenoh.Session) -> None:
        with self._lock:
            if self._closing.is_set():
                session.close()
                return
            self._session = session
            for topic in (CONFIGURATION, DECISION):
                self._declared.append(session.declare_queryable(self.key(topic), self._replier(topic)))
            self._declared.append(session.liveliness().declare_token(self.key(ALIVE)))

    def _keep_trying(self) -> None:
        problem = ""
        while not self._closing.is_set():
            try:
                session = open_session(self._endpoints)
            except DriverError as error:
                if problem != str(error):
                    problem = str(error)
                    log.warning("%s; it is tried again until it works", problem)
                self._closing.wait(RETRY_S)
            else:
                self._adopt(session)
                if problem:
                    log.info("zenoh: the session is open now")
                return

    def _publisher(self, topic: str) -> Any:
        if topic not in self._publishers:
            assert self._session is not None
            priority = zenoh.Priority.INTERACTIVE_HIGH if topic in IMPORTANT else zenoh.Priority.DATA
            self._publishers[topic] = self._session.declare_publisher(
                self.key(topic),
                encoding=zenoh.Encoding.APPLICATION_JSON,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=priority,
                reliability=zenoh.Reliability.RELIABLE,
            )
        return self._publishers[topic]

    def _replier(self, topic: str) -> Any:
        def reply(query: zenoh.Query) -> None:
            with query:
                payload = self._answers.get(topic)
                if payload is not None:
                    query.reply(self.key(topic), payload, encoding=zenoh.Encoding.APPLICATION_JSON)

        return reply


class Subscription:
    """A watcher's side: messages and comings and goings of one vehicle, or of all ("*").

    Deliveries wait in a bounded queue; the oldest go, and are counted in ``dropped``, when nobody takes them.
    """

    def __init__(self, endpoints: Endpoints, vehicle: str = "*", topics: Sequence[str] = ("*",)) -> None:
        self.dropped = 0
        self._queue: queue.Queue[Delivery] = queue.Queue(QUEUE_LENGTH)
        self._session = open_session(endpoints)
        self._vehicle = vehicle
        self._subscribers: dict[str, Any] = {}
        try:
            for topic in topics:
                self.add(topic)
            self._subscribers[ALIVE] = self._session.liveliness().declare_subscriber(
                f"{ROOT}/{vehicle}/{ALIVE}", self._on_liveliness, history=True
            )
        except zenoh.ZError as error:
            self._session.close()
            raise DriverError(f"zenoh: '{vehicle}' is no vehicle's name: {_brief(error)}") from None

    def add(self, topic: str) -> None:
        """Subscribe to one topic more."""
        if topic not in self._subscribers:
            self._subscribers[topic] = self._session.declare_subscriber(
                f"{ROOT}/{self._vehicle}/{topic}", self._on_sample
            )

    def remove(self, topic: str) -> None:
        """Subscribe to one topic less."""
        subscriber = self._subscribers.pop(topic, None)
        if subscriber is not None:
            subscriber.undeclare()

    def links(self) -> int:
        """How many routers and peers the session is connected to."""
        info = self._session.info
        return len(info.routers_zid()) + len(info.peers_zid())

    def receive(self, timeout_s: float) -> Delivery | None:
        """The next delivery, or None when none came in time."""
        try:
            return self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def ask(self, vehicle: str, topic: str, timeout_s: float = 2.0) -> bytes | None:
        """What a vehicle answers for ``configuration`` or ``decision``; None when it does not."""
        for reply in self._session.get(f"{ROOT}/{vehicle}/{topic}", timeout=timeout_s):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        return None

    def close(self) -> None:
        """End the session."""
        self._session.close()

    def __enter__(self) -> "Subscription":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        _, vehicle, topic = str(sample.key_expr).split("/", 2)
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        self._push(Delivery(vehicle, topic, sample.payload.to_bytes(), attachment=attachment))

    def _on_liveliness(self, sample: zenoh.Sample) -> None:
        _, vehicle, topic = str(sample.key_expr).split("/", 2)
        self._push(Delivery(vehicle, topic, alive=sample.kind == zenoh.SampleKind.PUT))

    def _push(self, delivery: Delivery) -> None:
        while True:
            try:
                self._queue.put_nowait(delivery)
                return
            except queue.Full:
                try:
                    self._queue.get_nowait()
                    self.dropped += 1
                except queue.Empty:
                    continue


def _config(endpoints: Endpoints) -> zenoh.Config:
    if endpoints.config_file and not Path(endpoints.config_file).is_file():
        raise DriverError(f"{endpoints.config_file}: there is no such zenoh configuration (zenoh.config)")
    try:
        config = zenoh.Config.from_file(endpoints.config_file) if endpoints.config_file else zenoh.Config()
        given: dict[str, Any] = {"mode": endpoints.mode}
        if endpoints.connect:
            given["connect/endpoints"] = list(endpoints.connect)
        if endpoints.listen or (not endpoints.config_file and not endpoints.scouting):
            given["listen/endpoints"] = list(endpoints.listen)
        if not endpoints.config_file:
            # Memory shared between processes gains nothing for messages of 1 kB and needs /dev/shm.
            given["transport/shared_memory/enabled"] = False
        given["transport/link/tx/queue/size/interactive_high"] = IMPORTANT_BATCHES
        given["scouting/multicast/enabled"] = endpoints.scouting
        given["connect/timeout_ms"] = {"peer": -1, "client": CONNECT_TIMEOUT_MS}
        given["connect/exit_on_failure"] = {"peer": False, "client": True}
        for path, value in given.items():
            config.insert_json5(path, json.dumps(value))
    except zenoh.ZError as error:
        raise DriverError(f"zenoh settings are not accepted: {_brief(error)}") from None
    return config


def _brief(error: zenoh.ZError) -> str:
    """zenoh's text without the source line it ends with."""
    return str(error).partition(" at /")[0].strip()
