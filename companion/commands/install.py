"""Install landslope as a systemd service on this machine, bring it up to date, or take it off again."""

import argparse
from pathlib import Path

from companion.commands.table import installed_documents
from companion.errors import LandslopeError
from companion.install.install import (
    DEFAULT_PREFIX,
    SETTINGS_DIRECTORY,
    InstallOptions,
    check_rights,
    command_on_path,
    install_steps,
    uninstall_steps,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("--dry-run", action="store_true", help="show the steps and take none of them")
    parser.add_argument(
        "--prefix", type=Path, default=DEFAULT_PREFIX, help="the virtual environment (default: %(default)s)"
    )
    parser.add_argument("--root", type=Path, help="lay the files out below this directory, for an image")
    parser.add_argument(
        "--package", default="", help="what pip installs: a wheel or a checkout (default: this version)"
    )
    parser.add_argument(
        "--system-site-packages",
        action="store_true",
        help="let the environment see the system's packages",
    )
    parser.add_argument("--no-enable", action="store_true", help="do not start the service at boot")
    parser.add_argument(
        "--uninstall", action="store_true", help="take it off again; settings and flights stay"
    )
    parser.add_argument("--purge", action="store_true", help="with --uninstall: settings and flights too")


def run(args: argparse.Namespace) -> int:
    """Take the steps, each said before it is taken."""
    if args.purge and not args.uninstall:
        raise LandslopeError(
            "--purge deletes settings and flights and goes with --uninstall alone: nothing was done"
        )
    options = InstallOptions(
        args.prefix,
        args.root,
        args.package,
        args.system_site_packages,
        enable=not args.no_enable,
        documents={} if args.uninstall else installed_documents(),
    )
    if not args.dry_run:
        check_rights(options)
    steps = uninstall_steps(options, args.purge) if args.uninstall else install_steps(options)
    for step in steps:
        print(step.text, flush=True)
        if not args.dry_run:
            step.act()
    if not args.uninstall:
        print(
            f"\nnext: edit {SETTINGS_DIRECTORY / 'landslope.toml'}, then\n"
            f"  {command_on_path(options)} doctor --config {SETTINGS_DIRECTORY / 'landslope.toml'}\n"
            "  systemctl start landslope\n"
            "users who may read flights: usermod -aG landslope USER"
        )
    return 0
