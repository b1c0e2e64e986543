"""Measured figures in the documentation: the command or test that made them stands near by, or that there is none."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from documented import PAGES
from places import REPOSITORY

GENERATED = ("messages.md", "settings.md")
MEASURED = re.compile(
    r"\b\d[\d,]* of (?:the |these )?\d"  # 13 of 15
    r"|\bmedians? (?:of )?\d|\d[^.|\n]{0,40}\bmedian\b|\| *median|percentile"
    r"|\+- ?\d|^## Measured|\btook \d|\bmeasured\b[^.]*\d (?:ms|s|m/s|MB|px|%|degrees)\b"
)
MADE_BY = re.compile(
    r"landslope (?:replay|sim|benchmark|fleet|experiments|calibrate|run) |systemd-analyze"
    r"|calibrate --time-offset|python (?:-m )?(?:tests/|companion)|pytest|\btest_\w+\.py|apt install"
    r"|not in\s+this\s+repository"  # said so
)
BEFORE, BEHIND = 4, 2
"""Paragraphs, tables and blocks of code of the same section that count as near."""


def sections(page: Path) -> Iterator[list[str]]:
    """The paragraphs of each section: what stands between blank lines, from heading to heading."""
    paragraphs: list[str] = []
    for paragraph in re.split(r"\n\s*\n", page.read_text()):
        if paragraph.lstrip().startswith("#"):
            yield paragraphs
            paragraphs = []
        paragraphs.append(paragraph)
    yield paragraphs


def without_a_command(page: Path) -> list[str]:
    """Paragraphs with figures that were measured and no command near them."""
    found = []
    for paragraphs in sections(page):
        for k, paragraph in enumerate(paragraphs):
            near = paragraphs[max(0, k - BEFORE) : k + BEHIND + 1]
            if MEASURED.search(paragraph) and not MADE_BY.search("\n".join(near)):
                found.append(paragraph)
    return found


@pytest.mark.parametrize(
    "page", [p for p in PAGES if p.name not in GENERATED], ids=lambda p: str(p.relative_to(REPOSITORY))
)
def test_measured_figures_stand_beside_the_command_that_made_them(page: Path):
    assert without_a_command(page) == []


def test_figures_without_a_command_are_found(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text(
        "# A\n\n`landslope sim stairs`\n\n13 of 15 landed.\n\n## B\n\n2 of 3 landed, 0.1 m median.\n"
    )
    assert without_a_command(page) == ["2 of 3 landed, 0.1 m median.\n"]
