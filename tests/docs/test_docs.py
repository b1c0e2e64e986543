"""The documentation: links and file names lead somewhere, commands exist and run, every page is in the index."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import documented
import pytest
from documented import PAGES, Command
from folder_edits import short_flight
from places import DOCS, REPOSITORY

from companion import cli

FLIGHTS = ("stairs_a", "ramp_a", "agile_a")
"""The recorded flights that commands name."""
NOT_RUN = {
    "run": "needs a camera and an autopilot",
    "watch": "ends only when it is stopped",
    "monitor": "ends only when it is stopped",
    "sim": "flies for half a minute, but for --list; tests/companion/simulation flies",
    "install": "changes the machine; tests/companion/install runs it",
    "doctor": "needs a camera and an autopilot; tests/companion/doctor runs it",
    "experiments": "takes minutes; tests/companion/experiments runs a selection",
    "benchmark": "takes minutes; tests/companion/benchmark runs a short one",
}
NOT_RUN_WITH = ("--publish", "--realtime", "--connect", "--config", "--time-offset", "--autopilot", "--runs")
"""Options that need a network, other programs, minutes, or files that only a user has."""
NOT_RUN_WORDS = (
    "measure",
    "serve",
    "rubble",
    "my_flight.toml",
    "stairs",
    "board.mkv",
    "walk.mp4",
    "images/",
    "worst/",
)
"""Beginnings of words of commands that take long or name a user's own files."""
IN_PLACE_OF = {"FLIGHT": "sitl_logs/stairs_a", "FILE": "landslope.toml", "NAME": "estimate"}
"""What the commands that run get where a reader puts something of his own."""


def page_name(page: Path) -> str:
    return str(page.relative_to(REPOSITORY))


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_links_and_named_files_are_there(page: Path):
    links = [link for link in documented.LINK.findall(page.read_text()) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []
    names = {
        path.name for path in REPOSITORY.rglob("*.py") if ".venv" not in path.parts[len(REPOSITORY.parts)]
    }
    missing = [
        name
        for name in documented.named_files(page)
        if not ((REPOSITORY / name).exists() if "/" in name else name in names)
    ]
    assert missing == []


def test_the_index_has_every_page():
    linked = {(DOCS / link).resolve() for link in documented.LINK.findall((DOCS / "README.md").read_text())}
    assert [page_name(page) for page in PAGES if page.name != "README.md" and page not in linked] == []


def test_the_readme_leads_to_the_index_and_names_every_command():
    text = (REPOSITORY / "README.md").read_text()
    assert "(docs/README.md)" in text
    assert [
        name for name in cli.COMMANDS if f"`landslope {name}" not in text and f"`{name}`" not in text
    ] == []


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_commands_shown_are_accepted_by_their_parsers(page: Path):
    for command in documented.commands(page):
        if command.program == "python":
            assert (REPOSITORY / command.name).exists(), command
            continue
        parser = cli.parser_for(command.name)
        if command.placeholders or command.mention:
            options = {word.split("=")[0] for word in command.words if word.startswith("--")}
            assert options <= known_options(parser), command
            continue
        try:
            parser.parse_args(command.words)
        except SystemExit:
            pytest.fail(f"{page_name(page)}: {command} is not accepted")


def known_options(parser) -> set[str]:
    """The options of a parser and of its subcommands."""
    known = {option for action in parser._actions for option in action.option_strings}
    for action in parser._actions:
        if isinstance(action.choices, dict):
            known |= set().union(*(known_options(sub) for sub in action.choices.values()))
    return known


def runnable(command: Command) -> bool:
    """Whether a command can run here: without a network, a camera, minutes of time or a user's files."""
    if command.program == "python":
        return command.name.endswith("score.py") and not command.placeholders
    options = [word.split("=")[0] for word in command.words]
    return (
        not command.mention
        and (command.name not in NOT_RUN or "--list" in options)
        and set(command.own_words) <= IN_PLACE_OF.keys()
        and not any(option in NOT_RUN_WITH for option in options)
        and not any(word.startswith(NOT_RUN_WORDS) for word in command.words)
    )


def runnable_once() -> dict[Path, list[tuple[str, str, tuple[str, ...]]]]:
    """Program, name and words of the commands of each page that can run here, at the first page that shows them."""
    seen: set[tuple[str, str, tuple[str, ...]]] = set()
    pages: dict[Path, list[tuple[str, str, tuple[str, ...]]]] = {}
    for page in PAGES:
        found = [(c.program, c.name, c.words) for c in documented.commands(page) if runnable(c)]
        pages[page] = [command for command in dict.fromkeys(found) if command not in seen]
        seen.update(found)
    return pages


RUNNABLE = runnable_once()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first second of a recorded flight, with its truth."""
    folder = short_flight(tmp_path_factory.mktemp("short") / "flight", seconds=1.0)
    return folder


@pytest.fixture
def clone(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory as the commands expect it, with short flights."""
    for name in FLIGHTS:
        shutil.copytree(short, tmp_path / "sitl_logs" / name)
    shutil.copy(REPOSITORY / "systemd" / "landslope.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_commands_of_every_kind_run():
    names = {name for found in RUNNABLE.values() for _, name, _ in found}
    assert {"check", "schema", "replay", "sim", "fleet", "calibrate", "export"} <= names


@pytest.mark.parametrize("page", [page for page in PAGES if RUNNABLE[page]], ids=page_name)
def test_commands_shown_run(page: Path, clone: Path, capsys: pytest.CaptureFixture[str]):
    for program, name, shown in RUNNABLE[page]:
        given = [IN_PLACE_OF.get(word, word) for word in shown]
        words = [
            str(found) for word in given for found in (sorted(Path().glob(word)) if "*" in word else [word])
        ]
        if program == "python":
            script = [sys.executable, str(REPOSITORY / name), *words]
            result = subprocess.run(script, capture_output=True, text=True, timeout=3600)
            assert result.returncode == 0, (name, shown, result.stderr)
            continue
        assert cli.main([name, *words]) == 0, (name, shown, capsys.readouterr().err)


def test_names_in_the_glossary_are_in_the_code():
    glossary = (DOCS / "conventions.md").read_text().partition("## Glossary")[2]
    rows = [line.split("|") for line in glossary.splitlines() if line.startswith("| ")]
    names = [name for row in rows for name in documented.SPAN.findall(row[4])]
    files = [f for folder in ("landing", "companion", "drivers") for f in (REPOSITORY / folder).rglob("*.py")]
    words = {word for file in files for word in re.findall(r"\w+", file.read_text())} | {
        f.name for f in files
    }
    parts = [part for name in names for part in ([name] if name.endswith(".py") else name.split("."))]
    assert len(names) > 80
    assert [part for part in parts if part and part not in words and part != "..._max_age_s"] == []
