"""The command line: finds the command in the table, runs it, and turns errors into one line and an exit code."""

import io
import sys

from companion.commands.closed_pipe import discard_output
from companion.commands.table import COMMANDS, parser_for
from companion.errors import LandslopeError
from drivers.errors import DriverError
from drivers.secrets import masked
from drivers.system.process_memory import keep_freed_memory
from landing.errors import LandingError


def usage() -> str:
    """The list of commands."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {text}" for name, (_, text) in COMMANDS.items()]
    return (
        "usage: landslope COMMAND ...\n\n"
        + "\n".join(lines)
        + "\n\n'landslope COMMAND --help' shows more, 'landslope --version' which one this is."
    )


def main(argv: list[str] | None = None) -> int:
    """Run one command; errors end as one line on stderr and exit code 2."""
    words = sys.argv[1:] if argv is None else argv
    unreadable = next((word for word in words if not _is_text(word)), None)
    if unreadable is not None:
        print(f"landslope: {unreadable!a}: this name is not UTF-8: rename it", file=sys.stderr)
        return 2
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if words else 2
    if words[0] == "--version":
        from importlib.metadata import version  # takes longer than all else that is imported here

        print(f"landslope {version('landslope')}")
        return 0
    if words[0] not in COMMANDS:
        import difflib

        near = difflib.get_close_matches(words[0], COMMANDS, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        print(f"landslope: there is no command '{words[0]}'{hint}\n\n{usage()}", file=sys.stderr)
        return 2
    args = parser_for(words[0]).parse_args(words[1:])
    try:
        code = args.run(args)
        sys.stdout.flush()
        return code
    except (LandslopeError, DriverError, LandingError) as error:
        print(f"landslope {words[0]}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        discard_output()
        return 141
    except OSError as error:
        print(f"landslope {words[0]}: {_of_the_system(error)}", file=sys.stderr)
        return 2


def _of_the_system(error: OSError) -> str:
    """A file, folder or address that cannot be used, in one line with what to do."""
    what = error.filename or error.filename2 or "the system"
    text = f"{masked(str(what))}: {error.strerror or error}"
    if isinstance(error, PermissionError):
        text += "; flights of the service may be read by the group 'landslope': usermod -aG landslope USER"
    return text


def _is_text(word: str) -> bool:
    """Whether a word of the command line is valid text: OpenCV and zenoh end the process on a name that is not."""
    return not any("\ud800" <= letter <= "\udfff" for letter in word)


def script() -> None:
    """The installed command: ends with main's code, even when a library hangs in a thread of its own."""
    keep_freed_memory()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(
            errors="backslashreplace"
        )  # names of files that are not in the locale's letters
    code = main()
    hanging = sys.modules.get("drivers.system.hanging")  # imported by the commands that need it alone
    if hanging is not None:
        hanging.end_past_hanging_threads(code)
    sys.exit(code)


if __name__ == "__main__":
    script()
