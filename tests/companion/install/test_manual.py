"""Completion and man page: made from the parsers, taken by the real shells, installed and taken off."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from companion.cli import COMMANDS, main, parser_for
from companion.commands.table import installed_documents
from companion.install.install import InstallOptions, install_steps, uninstall_steps
from companion.install.manual import BASH, DOCUMENTS, MAN, ZSH


@pytest.fixture(scope="module")
def documents() -> dict[Path, str]:
    return installed_documents()


def completed(script: str, *words: str) -> list[str]:
    """What bash offers for the last of the words."""
    line = " ".join(f"'{word}'" for word in words)
    call = f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _landslope"
    show = "printf '%s\\n' \"${COMPREPLY[@]}\""
    done = subprocess.run(
        ["bash", "-c", f"{script}\n{call}; {show}"], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes_commands_options_choices_and_files(documents, tmp_path, monkeypatch):
    script = documents[BASH]
    assert completed(script, "landslope", "re") == ["replay"]
    assert set(completed(script, "landslope", "")) == {*COMMANDS, "--help", "--version"}
    assert completed(script, "landslope", "replay", "--enable-f") == ["--enable-from-rc"]
    assert completed(script, "landslope", "calibrate", "--paper", "a") == ["a4", "a3", "a2"]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flight_7").mkdir()
    assert completed(script, "landslope", "replay", "fli") == ["flight_7"]


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not installed")
def test_zsh_takes_the_completion(documents, tmp_path):
    file = tmp_path / "_landslope"
    file.write_text(documents[ZSH])
    subprocess.run(["zsh", "-n", str(file)], check=True, capture_output=True)


def test_every_command_and_option_is_in_every_document(documents):
    for name in COMMANDS:
        options = [word for action in parser_for(name)._actions for word in action.option_strings]
        assert f"landslope {name}" in documents[MAN]
        for word in options:
            assert word in documents[BASH]
            assert word in documents[ZSH]
            assert word.replace("-", "\\-") in documents[MAN]


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_the_man_page_is_formatted_without_a_warning(documents):
    done = subprocess.run(
        ["groff", "-man", "-Tascii", "-ww"], input=documents[MAN], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""
    assert "landslope replay" in re.sub(".\x08", "", done.stdout)  # letters are struck twice to be bold


@pytest.mark.parametrize("kind", ["bash", "zsh", "man"])
def test_the_documents_are_printed(kind: str, documents, capsys):
    assert main(["completion", kind]) == 0
    assert capsys.readouterr().out in documents.values()


def test_install_puts_them_in_place_and_takes_them_off(documents, tmp_path):
    options = InstallOptions(root=tmp_path, enable=False, documents=documents)
    for step in install_steps(options):
        step.act()
    assert [(tmp_path / path.relative_to("/")).read_text() for path in DOCUMENTS] == list(documents.values())
    for step in uninstall_steps(options, purge=False):
        step.act()
    assert not [path for path in DOCUMENTS if (tmp_path / path.relative_to("/")).exists()]
