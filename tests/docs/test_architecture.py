"""The rooms of the code: their picture is up to date, they have no cycles, and they stay small."""

import ast
from pathlib import Path

import draw_rooms
import pytest
from places import REPOSITORY

MAX_LINES, MAX_MODULES = 350, 20
HOW = "run 'python tests/tools/draw_rooms.py'"
FILES = [
    file
    for package in (*draw_rooms.PACKAGES, "tests")
    for file in sorted((REPOSITORY / package).rglob("*.py"))
    if "__pycache__" not in file.parts
]


@pytest.fixture(scope="module")
def rooms() -> dict[str, draw_rooms.Room]:
    return draw_rooms.rooms()


def test_the_picture_and_the_table_are_those_of_the_code(rooms: dict[str, draw_rooms.Room]):
    page = draw_rooms.PAGE.read_text()
    assert draw_rooms.PICTURE.read_text() == draw_rooms.picture(rooms), HOW
    assert draw_rooms.page_with(page, draw_rooms.table(rooms)) == page, HOW


def test_no_folder_imports_itself_through_another(rooms: dict[str, draw_rooms.Room]):
    assert draw_rooms.cycle({name: room.imports for name, room in rooms.items()}) == []


def test_a_cycle_is_found():
    assert draw_rooms.cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == ["a", "b", "c"]


def test_an_import_that_follows_from_others_is_not_drawn():
    assert draw_rooms.reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {
        "a": {"b"},
        "b": {"c"},
        "c": set(),
    }


def test_every_folder_says_in_one_sentence_what_it_is_for(rooms: dict[str, draw_rooms.Room]):
    folders = [room for room in rooms.values() if room.is_folder]
    assert folders
    assert [room.name for room in folders if not room.purpose.endswith(".")] == []


def test_every_module_says_what_it_is_for():
    assert [str(file) for file in FILES if not ast.get_docstring(ast.parse(file.read_text()))] == []


def test_files_and_folders_stay_small():
    long = [str(file) for file in FILES if len(file.read_text().splitlines()) > MAX_LINES]
    assert long == []
    folders: dict[Path, int] = {}
    for file in FILES:
        if file.name != "__init__.py":
            folders[file.parent] = folders.get(file.parent, 0) + 1
    assert {str(folder): count for folder, count in folders.items() if count > MAX_MODULES} == {}
