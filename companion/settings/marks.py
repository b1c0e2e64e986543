"""Annotations of settings, beside ``landing.options.Limits``: meaning, file path, for users or internal."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a setting without limits (text, switch, choice) is for; stands in ``Annotated``."""

    meaning: str


class UserSettings:
    """Marks a section in ``Settings``: the settings named here are for users, its others are internal.

    A section without the mark is for users as a whole. Internal settings can be set as any other; only
    ``landslope check --all`` lists them.
    """

    def __init__(self, *names: str) -> None:
        self.names = names


@dataclass(frozen=True, slots=True)
class FilePath:
    """A path; in a settings file relative to that file, in ``--set`` to the working directory."""

    meaning: str = ""
    must_exist: bool = True
    or_key: bool = False
    """Whether a key in hexadecimal digits may stand there in place of a path."""
