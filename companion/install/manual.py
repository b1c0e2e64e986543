"""Completion for bash and zsh, and the man page, made of the commands' argument parsers."""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

BASH = Path("/usr/local/share/bash-completion/completions/landslope")
ZSH = Path("/usr/local/share/zsh/site-functions/_landslope")
MAN = Path("/usr/local/share/man/man1/landslope.1")
DOCUMENTS = (BASH, ZSH, MAN)
"""Where the shells and man look for what an administrator installed."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command: a line of help and its parser."""

    text: str
    parser: argparse.ArgumentParser

    @property
    def actions(self) -> list[argparse.Action]:
        """Its arguments in the order of its help, those of its parts behind them."""
        return list(_actions(self.parser))

    @property
    def options(self) -> list[str]:
        """All spellings of its options."""
        return [word for action in self.actions for word in action.option_strings]


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    yield from parser._actions
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for part in action.choices.values():
                yield from (own for own in _actions(part) if own.dest != "help")


def documents(commands: Mapping[str, Command], version: str) -> dict[Path, str]:
    """Every document by the path it is installed at."""
    return {BASH: bash(commands), ZSH: zsh(commands), MAN: man(commands, version)}


def bash(commands: Mapping[str, Command]) -> str:
    """The completion for bash: commands, their options, choices, else files."""
    cases = []
    for name, command in commands.items():
        lines = [f"        {name})", f'            options="{" ".join(command.options)}"']
        chosen = [action for action in command.actions if action.option_strings and action.choices]
        if chosen:
            lines.append('            case "$before" in')
            for action in chosen:
                choices = " ".join(map(str, action.choices or ()))
                lines.append(f'                {"|".join(action.option_strings)}) choices="{choices}" ;;')
            lines.append("            esac")
        cases += [*lines, "            ;;"]
    return "\n".join(
        [
            "# bash completion for landslope; made from its argument parsers",
            "_landslope() {",
            '    local word="${COMP_WORDS[COMP_CWORD]}" before="${COMP_WORDS[COMP_CWORD-1]}" options="" choices=""',
            '    if [ "$COMP_CWORD" -eq 1 ]; then',
            f'        COMPREPLY=($(compgen -W "{" ".join(commands)} --help --version" -- "$word"))',
            "        return",
            "    fi",
            '    case "${COMP_WORDS[1]}" in',
            *cases,
            "    esac",
            '    if [ -n "$choices" ]; then',
            '        COMPREPLY=($(compgen -W "$choices" -- "$word"))',
            '    elif [ "${word:0:1}" = "-" ]; then',
            '        COMPREPLY=($(compgen -W "$options" -- "$word"))',
            "    else",
            '        COMPREPLY=($(compgen -f -- "$word"))',
            "    fi",
            "}",
            "complete -o filenames -F _landslope landslope",
            "",
        ]
    )


def zsh(commands: Mapping[str, Command]) -> str:
    """The completion for zsh, with a line of help for each command and option."""
    lines = ["#compdef landslope", "# zsh completion for landslope; made from its argument parsers", ""]
    lines += ["_landslope() {", "    local -a commands", "    commands=("]
    lines += [f"        {_quoted(f'{name}:{command.text}')}" for name, command in commands.items()]
    lines += ["    )", "    if (( CURRENT == 2 )); then", "        _describe command commands"]
    lines += [
        "        return",
        "    fi",
        '    local name="$words[2]"',
        "    shift words",
        "    (( CURRENT-- ))",
    ]
    lines.append('    case "$name" in')
    for name, command in commands.items():
        lines.append(f"        {name})")
        specs = " ".join(_quoted(spec) for spec in _zsh_specs(command))
        lines += [f"            _arguments {specs} '*:file:_files'", "            ;;"]
    return "\n".join([*lines, "    esac", "}", "", '_landslope "$@"', ""])


def _zsh_specs(command: Command) -> Iterator[str]:
    for action in command.actions:
        text = _help(action).replace("[", "(").replace("]", ")").replace(":", " -")
        for word in action.option_strings:
            spec = f"{word}[{text}]"
            if action.nargs != 0:
                values = f"({' '.join(map(str, action.choices))})" if action.choices else "_files"
                spec += f":{action.dest}:{values}"
            yield spec


def man(commands: Mapping[str, Command], version: str) -> str:
    """The man page, section 1."""
    lines = [f'.TH LANDSLOPE 1 "" "landslope {version}" "User commands"', ".SH NAME"]
    lines += ["landslope \\- slope and flatness of the ground below a drone, and the command to land on it"]
    lines += [
        ".SH SYNOPSIS",
        ".B landslope",
        ".I COMMAND",
        "[arguments]",
        ".br",
        ".B landslope \\-\\-version",
    ]
    lines += [".SH DESCRIPTION", "One command does one thing; each takes", ".B \\-\\-help .", ".SH COMMANDS"]
    for name, command in commands.items():
        lines += [f".SS landslope {name}", _roff(command.parser.description or command.text)]
        for action in command.actions:
            lines += [".TP", f".B {_roff(_spelled(action))}", _roff(_help(action)) or _roff(action.dest)]
    lines += [
        ".SH EXIT STATUS",
        "0 when all is well, 1 when a check failed, 2 when an input or an option is wrong.",
    ]
    lines += [".SH FILES", ".TP", ".B /etc/landslope/landslope.toml", "The settings of the service."]
    lines += [".TP", ".B /var/lib/landslope", "Recorded flights."]
    return "\n".join([*lines, ""])


def _spelled(action: argparse.Action) -> str:
    """An argument as a usage line has it."""
    value = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
    if not action.option_strings:
        return str(value)
    words = ", ".join(action.option_strings)
    return f"{words} {value}" if action.nargs != 0 else words


def _help(action: argparse.Action) -> str:
    """An argument's help in one line, its default filled in."""
    try:
        text = (action.help or "") % {**vars(action), "prog": "landslope"}
    except (KeyError, TypeError, ValueError):
        text = action.help or ""
    return " ".join(text.split())


def _roff(text: str) -> str:
    text = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text.startswith((".", "'")) else text


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"
