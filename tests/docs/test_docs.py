"""The documentation: its links lead somewhere, and the commands and options it shows exist."""

import re
import shlex
from pathlib import Path

import pytest
from places import REPOSITORY

from companion import cli

PAGES = [
    REPOSITORY / "README.md",
    *sorted((REPOSITORY / "docs").glob("*.md")),
    REPOSITORY / "sitl_logs" / "README.md",
]
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
COMMAND = re.compile(r"(?:^|[ `/])landslope ((?:[a-z]+)[^`|\n]*)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_links_lead_to_files_of_the_project(page: Path):
    links = [link for link in LINK.findall(page.read_text()) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize(
    "page", [REPOSITORY / "README.md", REPOSITORY / "docs" / "replay.md"], ids=lambda page: page.name
)
def test_the_commands_shown_exist_and_take_the_options_shown(page: Path):
    found = 0
    for line in page.read_text().splitlines():
        if not line.startswith("    "):
            continue
        for text in COMMAND.findall(line):
            name, *words = shlex.split(text.split("&")[0])
            if name not in cli.COMMANDS:
                continue
            found += 1
            options = {word.split("=")[0] for word in words if word.startswith("--")}
            known = {option for action in cli.parser_for(name)._actions for option in action.option_strings}
            assert options <= known
    assert found


def test_the_readme_names_every_command():
    text = (REPOSITORY / "README.md").read_text()
    assert [
        name for name in cli.COMMANDS if f"`landslope {name}" not in text and f"`{name}`" not in text
    ] == []
