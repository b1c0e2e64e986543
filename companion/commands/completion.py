"""Print the completion for bash or zsh, or the man page, as 'landslope install' puts them in place."""

import argparse

KINDS = ("bash", "zsh", "man")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("kind", choices=KINDS, help="what is printed")


def run(args: argparse.Namespace) -> int:
    """Print one document."""
    from companion.commands.table import installed_documents

    print(dict(zip(KINDS, installed_documents().values(), strict=True))[args.kind], end="")
    return 0
