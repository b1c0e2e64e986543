"""The web server around the page."""

from pathlib import Path

import uvicorn
from fastapi import FastAPI
from nicegui import Client, ui

from companion.monitor.access import Gate
from companion.monitor.feed import Feed
from companion.monitor.page import Page
from companion.monitor.state import Watch

RESENT_AFTER_A_GAP = 20
"""Updates kept for a browser whose connection breaks for a moment; each may hold a picture."""
SHUTDOWN_S = 3


def application(watch: Watch, feed: Feed, token: str | None, *, secure: bool) -> Gate:
    """The ASGI application."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @ui.page("/", title="landslope")
    def index(client: Client, vehicle: str | None = None) -> None:
        # Only a browser that connects looks; a bare request for the page never says good-bye.
        client.on_connect(lambda: feed.look(client.id))
        client.on_delete(lambda: feed.look_away(client.id))
        Page(watch, feed, vehicle)

    ui.run_with(
        app,
        title="landslope",
        favicon=_icon(),
        tailwind=False,
        language="en-US",
        message_history_length=RESENT_AFTER_A_GAP,
        show_welcome_message=False,
    )
    return Gate(app, token, secure=secure)


def serve(app: Gate, host: str, port: int, certificate: Path | None = None, key: Path | None = None) -> None:
    """Serve until interrupted."""
    server = uvicorn.Server(
        uvicorn.Config(
            app,
            host=host,
            port=port,
            log_level="warning",
            ssl_certfile=certificate,
            ssl_keyfile=key,
            timeout_graceful_shutdown=SHUTDOWN_S,
        )
    )
    server.run()


def _icon() -> str:
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="6"/>'
        '<path d="M3 26L29 14" stroke="#fff" stroke-width="4"/>'
        '<path d="M10 8h12M16 8v6" stroke="#4da3ff" stroke-width="3"/></svg>'
    )
