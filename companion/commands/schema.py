"""Print the JSON Schema of one message or of all."""

import argparse
import json

from companion.messages import schema


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "name", nargs="?", help="estimate, decision, health, event or preview; all if left out"
    )
    parser.add_argument(
        "--table", action="store_true", help="print the documentation's Markdown tables instead"
    )


def run(args: argparse.Namespace) -> int:
    """Print what was asked for."""
    if args.table:
        print(schema.tables(), end="")
        return 0
    wanted = schema.schema_of(args.name) if args.name else schema.all_schemas()
    print(json.dumps(wanted, indent=2))
    return 0
