"""Small parts of the page."""

from collections.abc import Sequence
from html import escape

from nicegui import ui

from companion.monitor.words import clipped

MOST_WORDS = 12


def lines_of(texts: Sequence[str]) -> str:
    """Texts of a vehicle, a line each, as many as a page can bear."""
    return "\n".join(clipped(text) for text in texts[:MOST_WORDS])


def label(look: str, field: str) -> ui.label:
    """A text that is found by its field."""
    return ui.label().classes(look).props(f"data-field={field}")


def heading(title: str) -> None:
    """A heading of the second level."""
    ui.html(escape(title), tag="h2", sanitize=False)


def card(title: str) -> ui.element:
    """A section with a heading."""
    section = ui.element("section").classes("card")
    with section:
        heading(title)
    return section
