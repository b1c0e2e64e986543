"""JSON Schema and documentation tables of every message, made from the message types."""

from collections.abc import Mapping
from typing import Any

import msgspec

from companion.errors import LandslopeError
from companion.messages.events import EVENTS
from companion.messages.messages import TOPICS, Topic
from companion.messages.preview import Preview
from drivers.refusals import REFUSAL_MEANING
from landing.decision.withheld import WORDS
from landing.reasons import MEANING, STATUS_MEANING

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def message_type(topic: Topic) -> type:
    """The struct of a topic; the preview's is the JSON that rides on its JPEG."""
    return Preview if topic.type is None else topic.type


def topic_named(name: str) -> Topic:
    """The topic of that name; LandslopeError if there is none."""
    for topic in TOPICS:
        if topic.name == name:
            return topic
    known = ", ".join(topic.name for topic in TOPICS)
    raise LandslopeError(f"there is no message '{name}'; the messages are {known}")


def schema_of(name: str) -> dict[str, Any]:
    """The self-contained JSON Schema (2020-12) of one message; fields with a unit say so under ``unit``."""
    (reference,), components = msgspec.json.schema_components(
        [message_type(topic_named(name))], ref_template="#/$defs/{name}"
    )
    title = reference["$ref"].rsplit("/", 1)[1]
    for part in components.values():
        for field in part.get("properties", {}).values():
            _list_values(field)
    top = components.pop(title)
    schema = {"$schema": DIALECT, "$id": f"landslope/{name}", **top}
    return {**schema, "$defs": components} if components else schema


def _list_values(field: dict[str, Any]) -> None:
    """Say in JSON Schema's own words that a field holds values of a table."""
    values = field.pop("one_of", None)
    if values is not None and field.get("type") == "array":
        field["items"] = {**field["items"], "enum": values}
    elif values is not None:
        field["enum"] = values


def all_schemas() -> dict[str, dict[str, Any]]:
    """Every message's schema by topic name."""
    return {topic.name: schema_of(topic.name) for topic in TOPICS}


def keys_table() -> str:
    """A Markdown table of the keys."""
    rows = ["| key | payload | rate | recorded |", "|---|---|---|---|"]
    for topic in TOPICS:
        title = message_type(topic).__name__
        payload = (
            f"JPEG (`image/jpeg`), [{title}](#{title.lower()}) as JSON in the attachment"
            if topic.type is None
            else f"[{title}](#{title.lower()}) (`application/json`)"
        )
        recorded = "yes" if topic.recorded else "no"
        rows.append(f"| `landslope/<vehicle>/{topic.name}` | {payload} | {topic.rate} | {recorded} |")
    return "\n".join(rows)


def fields_table(name: str, schema: dict[str, Any]) -> str:
    """A Markdown section with one row a field of an object schema."""
    rows = [
        f"### {name}",
        "",
        schema.get("description", "").split("\n")[0],
        "",
        "| field | type | unit | meaning |",
        "|---|---|---|---|",
    ]
    rows += [
        f"| `{field}` | {_type_words(part)} | {part.get('unit', '')} | {part.get('description', '')} |"
        for field, part in schema["properties"].items()
    ]
    return "\n".join(rows)


def tables() -> str:
    """All of the documentation's tables: the keys, then every message's fields."""
    parts = [keys_table()]
    shown: set[str] = set()
    for topic in TOPICS:
        schema = schema_of(topic.name)
        inner = schema.get("$defs", {})
        for title, part in ((schema["title"], schema), *inner.items()):
            if title not in shown:
                shown.add(title)
                parts.append(fields_table(title, part))
    parts += [
        values_table("Statuses of an estimate", "status", STATUS_MEANING),
        values_table("Reasons of a verdict", "code", MEANING),
        values_table("What withholds a request", "code", WORDS),
        values_table("Why an input is refused", "code", REFUSAL_MEANING),
        events_table(),
    ]
    return "\n\n".join(parts) + "\n"


def values_table(title: str, head: str, meanings: Mapping[Any, str]) -> str:
    """A Markdown section with one row a value of a table."""
    rows = [f"### {title}", "", f"| {head} | meaning |", "|---|---|"]
    return "\n".join(rows + [f"| `{value}` | {meaning} |" for value, meaning in meanings.items()])


def events_table() -> str:
    """A Markdown section with one row an event."""
    rows = ["### Events", "", "| event | severity | meaning |", "|---|---|---|"]
    return "\n".join(rows + [f"| `{name}` | {grave} | {text} |" for name, (grave, text) in EVENTS.items()])


def _type_words(part: dict[str, Any]) -> str:
    if "$ref" in part:
        title = part["$ref"].rsplit("/", 1)[1]
        return f"[{title}](#{title.lower()})"
    if "anyOf" in part:
        return " or ".join(_type_words(option) for option in part["anyOf"])
    if part.get("type") == "array":
        return f"array of {_type_words(part['items'])}" if part.get("items") else _row_words(part)
    if part.get("type") == "object" and isinstance(part.get("additionalProperties"), dict):
        return f"object of {_type_words(part['additionalProperties'])}"
    return str(part.get("type", "any"))


def _row_words(part: dict[str, Any]) -> str:
    places = part.get("prefixItems", [])
    return f"{len(places)} {_type_words(places[0])}s" if places else "array"
