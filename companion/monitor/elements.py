"""Small parts of the monitor's page that several cards use: labels, headings, cards, lists of texts (NiceGUI)."""

from collections.abc import Sequence
from html import escape

from nicegui import ui

from companion.monitor.words import clipped

MOST_WORDS = 12
"""Texts shown at once; a vehicle may send any number."""


def lines_of(texts: Sequence[str]) -> str:
    """The first MOST_WORDS texts of a vehicle, one a line, each clipped."""
    return "\n".join(clipped(text) for text in texts[:MOST_WORDS])


def label(look: str, field: str) -> ui.label:
    """An empty text with the CSS classes ``look``; scripts and tests find it by its attribute ``data-field``."""
    return ui.label().classes(look).props(f"data-field={field}")


def heading(title: str) -> None:
    """A heading of the second level; ``title`` is plain text, not HTML."""
    ui.html(escape(title), tag="h2", sanitize=False)


def card(title: str) -> ui.element:
    """A section with a heading; to be used in a ``with`` statement, whose elements it then contains."""
    section = ui.element("section").classes("card")
    with section:
        heading(title)
    return section
