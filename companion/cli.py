"""The command line: one table of commands, each a module of its own that is imported only when it is called."""

import argparse
import importlib
import importlib.metadata
import sys

from companion.commands.closed_pipe import discard_output
from companion.errors import LandslopeError
from drivers.errors import DriverError
from drivers.system.process_memory import keep_freed_memory
from landing.errors import LandingError

COMMANDS = {
    "run": ("companion.commands.run", "the daemon: live camera and autopilot in, estimates and landings out"),
    "replay": (
        "companion.commands.replay",
        "run recorded flights, videos or image folders through the pipeline",
    ),
    "check": (
        "companion.commands.check",
        "say what is wrong with a settings file, or print the settings in force",
    ),
    "monitor": ("companion.commands.monitor", "show vehicles live on a web page or in Foxglove"),
    "export": ("companion.commands.export", "write a recorded flight for the robotics tools (MCAP)"),
    "schema": ("companion.commands.schema", "print the JSON Schema of the messages"),
    "fleet": ("companion.commands.fleet", "measure losses and delay of many vehicles under one zenoh router"),
    "experiments": (
        "companion.commands.experiments",
        "run the experiments of the method's paper and write a report",
    ),
    "watch": ("companion.commands.watch", "show a vehicle's messages live in the terminal"),
    "install": ("companion.commands.install", "install landslope as a systemd service, or take it off again"),
    "sim": ("companion.commands.sim", "fly a simulated drone over simulated ground, closed loop"),
    "compare": ("companion.commands.compare", "what a change did to many simulated flights, from two tables"),
    "calibrate": (
        "companion.commands.calibrate",
        "calibrate the camera, print a board, measure its time offset",
    ),
    "benchmark": ("companion.commands.benchmark", "measure what a frame costs on this machine"),
    "doctor": ("companion.commands.doctor", "look at camera, link, clocks and disk before a flight"),
}
"""Name -> (module with add_arguments(parser) and run(args) -> exit code, one line of help)."""


def parser_for(name: str) -> argparse.ArgumentParser:
    """The argument parser of one command."""
    module = importlib.import_module(COMMANDS[name][0])
    parser = argparse.ArgumentParser(prog=f"landslope {name}", description=module.__doc__)
    module.add_arguments(parser)
    parser.set_defaults(run=module.run)
    return parser


def usage() -> str:
    """The list of commands."""
    width = max(map(len, COMMANDS))
    lines = [f"  {name:<{width}}  {text}" for name, (_, text) in COMMANDS.items()]
    return (
        "usage: landslope COMMAND ...\n\n"
        + "\n".join(lines)
        + "\n\n'landslope COMMAND --help' tells more, 'landslope --version' which one this is."
    )


def main(argv: list[str] | None = None) -> int:
    """Run one command; errors end as one line on stderr and exit code 2."""
    words = sys.argv[1:] if argv is None else argv
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if words else 2
    if words[0] == "--version":
        print(f"landslope {importlib.metadata.version('landslope')}")
        return 0
    if words[0] not in COMMANDS:
        print(f"landslope: there is no command '{words[0]}'\n\n{usage()}", file=sys.stderr)
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


def script() -> None:
    """The installed command: ends with main's code, even when a library hangs in a thread of its own."""
    keep_freed_memory()
    code = main()
    hanging = sys.modules.get("drivers.system.hanging")  # imported by the commands that need it alone
    if hanging is not None:
        hanging.end_past_hanging_threads(code)
    sys.exit(code)


if __name__ == "__main__":
    script()
