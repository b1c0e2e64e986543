"""What the documentation shows: its pages, the command lines in them and the files that they name."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from places import DOCS, REPOSITORY

from companion import cli

PAGES = [REPOSITORY / "README.md", *sorted(DOCS.glob("*.md")), REPOSITORY / "sitl_logs" / "README.md"]

LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
SPAN = re.compile(r"`([^`\n]+)`")
BLOCK = re.compile(r"(?m)^ {4,}(\S.*)$")
PATH = re.compile(r"(?<![\w/])((?:landing|companion|drivers|docs|tests|systemd|sitl_logs)/[\w./-]*\w\.\w+)")
MODULE = re.compile(r"(?<![\w./])(\w+\.py)\b")
PLACEHOLDER = re.compile(r"^[A-Z][A-Z_]*(\.\w+|\.\.\.|[:/=].*)?$")


@dataclass(frozen=True)
class Command:
    """One command line of ours: ``landslope NAME WORDS`` or ``python FILE WORDS``."""

    program: str
    name: str
    words: tuple[str, ...]
    in_text: bool = False

    @property
    def own_words(self) -> list[str]:
        """The words that a reader replaces with something of his own."""
        return [word for word in self.words if PLACEHOLDER.match(word.rpartition("=")[2])]

    @property
    def placeholders(self) -> bool:
        """Whether there are any."""
        return bool(self.own_words)

    @property
    def mention(self) -> bool:
        """Whether the text only speaks of the command or of an option: nothing but its name and bare options."""
        return self.in_text and all(word.startswith("-") for word in self.words)

    def __str__(self) -> str:
        return shlex.join((self.program, self.name, *self.words))


def commands(page: Path) -> Iterator[Command]:
    """Every command line of ours on a page, in order: in indented blocks and between backticks."""
    for line in page.read_text().splitlines():
        block = BLOCK.match(line)
        for text in [block[1]] if block else SPAN.findall(line):
            for part in re.split(r"&&|[|&>]|\s#\s", text):
                yield from _command(part, not block)


def _command(text: str, in_text: bool) -> Iterator[Command]:
    try:
        words = shlex.split(text)
    except ValueError:
        return
    while words and (words[0] in ("sudo", "nice") or re.match(r"^-[un]$|^-?\d+$|^landslope$", words[0])):
        if words[0] == "landslope" and len(words) > 1 and words[1] in cli.COMMANDS:
            break
        words.pop(0)
    if len(words) < 2:
        return
    program = words[0].rpartition("/")[2]
    if (program == "landslope" and words[1] in cli.COMMANDS) or (
        program == "python" and words[1].endswith(".py")
    ):
        yield Command(program, words[1], tuple(words[2:]), in_text)


def named_files(page: Path) -> set[str]:
    """Files that a page names: paths from the top, and modules by their name alone."""
    text = page.read_text()
    alone = {name for span in SPAN.findall(text) if "/" not in span for name in MODULE.findall(span)}
    return set(PATH.findall(text)) | alone
