"""Compare two tables of flights ('landslope sim --runs N --table FOLDER'): what a change did, in Markdown.

Shares have their 95 % confidence intervals. The exit code is 1 when a flight became worse, else 0.
"""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "before", type=Path, metavar="A.parquet", help="table of the flights before the change"
    )
    parser.add_argument("after", type=Path, metavar="B.parquet", help="table of the same flights after it")


def run(args: argparse.Namespace) -> int:
    """Print the comparison."""
    from companion.simulation.counting.compare import comparison, worse_flights
    from companion.simulation.result_table import read_rows

    before, after = read_rows(args.before), read_rows(args.after)
    print(comparison(before, after))
    return 1 if worse_flights(before, after) else 0
