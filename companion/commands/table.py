"""One table of commands, each a module of its own that is imported only when it is called."""

import argparse
import importlib
from pathlib import Path

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
    "completion": ("companion.commands.completion", "print the completion for bash or zsh, or the man page"),
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


def installed_documents() -> dict[Path, str]:
    """The completions and the man page of all commands, by the path they are installed at."""
    from importlib.metadata import version  # takes long, and no other command needs it

    from companion.install.manual import Command, documents

    commands = {name: Command(text, parser_for(name)) for name, (_, text) in COMMANDS.items()}
    return documents(commands, version("landslope"))
