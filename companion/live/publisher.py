"""Messages onto the bus: encoded, under their topics, with the configuration answered on request."""

import time

import msgspec

from companion.messages.messages import Message, encode, topic_of
from companion.settings.masking import without_secrets
from companion.settings.settings import Settings, ZenohSettings
from drivers.bus import CONFIGURATION, DECISION, Bus, Endpoints

POLL_S = 0.02


def endpoints(settings: ZenohSettings) -> Endpoints:
    """The [zenoh] section as the driver takes it."""
    return Endpoints(
        mode=settings.mode,
        connect=settings.connect,
        listen=settings.listen,
        scouting=settings.scouting,
        config_file=settings.config,
    )


class Publisher:
    """A vehicle on the bus. With ``retry`` an absent router is waited for in the background."""

    def __init__(self, settings: Settings, *, retry: bool = False) -> None:
        self.bus = Bus(settings.vehicle.name, endpoints(settings.zenoh), retry=retry)
        self.set_settings(settings)

    def set_settings(self, settings: Settings) -> None:
        """The configuration that is answered from now on, without its secrets."""
        self.bus.answer(CONFIGURATION, msgspec.json.encode(without_secrets(settings)))

    def publish(self, message: Message) -> None:
        """Put one message; never waits for a subscriber."""
        self.bus.put(topic_of(message), encode(message))

    def await_subscriber(self, timeout_s: float) -> bool:
        """Wait until somebody subscribes to decisions, but not for longer; returns whether somebody does."""
        end = time.monotonic() + timeout_s
        while not (found := self.bus.subscribed(DECISION)) and time.monotonic() < end:
            time.sleep(POLL_S)
        return found

    def close(self) -> None:
        """Leave the bus."""
        self.bus.close()

    def __enter__(self) -> "Publisher":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
