"""Measure what a frame costs on this machine, on one core, beside OpenCV's corner detection and tracking alone.

The frames are those of a recorded flight, resized. Times are processor time, medians over the frames in which a stage
ran; where that is not every frame, the share stands behind.
"""

import argparse
from pathlib import Path

from companion.errors import LandslopeError

SMALLEST_PX, LARGEST_PX = 64, 4096


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "--flight",
        type=Path,
        default=Path("sitl_logs/stairs_a"),
        metavar="FLIGHT",
        help="flight, video or image folder to take the frames from (sitl_logs/stairs_a)",
    )
    parser.add_argument(
        "--sizes",
        type=sizes,
        default=sizes("160x120,320x240,640x480"),
        metavar="WxH,...",
        help="sizes of the frames (160x120,320x240,640x480)",
    )
    parser.add_argument("--frames", type=int, default=300, help="how many frames (300)")
    parser.add_argument("--start", type=int, default=300, help="the first of them (300)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    parser.add_argument(
        "--daemon",
        action="store_true",
        help="measure the whole daemon as well: latency from camera to zenoh, processor time, memory",
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="of the daemon at each size (10)")
    parser.add_argument("--preview", action="store_true", help="measure the preview pictures as well")


def sizes(text: str) -> list[tuple[int, int]]:
    """Widths and heights of "WxH,WxH,..."."""
    found = []
    for word in text.split(","):
        width, x, height = word.strip().partition("x")
        if not (x and width.isascii() and width.isdigit() and height.isascii() and height.isdigit()):
            raise argparse.ArgumentTypeError(f"'{word}' is no size: write WIDTHxHEIGHT, as 320x240")
        size = int(width), int(height)
        if min(size) < SMALLEST_PX or max(size) > LARGEST_PX:
            raise argparse.ArgumentTypeError(f"{word}: sides must lie between {SMALLEST_PX} and {LARGEST_PX}")
        found.append(size)
    return found


def run(args: argparse.Namespace) -> int:
    """Measure and print."""
    from companion.benchmark import benchmark

    if args.frames < benchmark.FEWEST:
        raise LandslopeError(f"--frames {args.frames}: at least {benchmark.FEWEST}")
    if args.start < 0:
        raise LandslopeError(f"--start {args.start}: must not be negative")
    if not 1 <= args.seconds <= 86_400:
        raise LandslopeError(f"--seconds {args.seconds:g}: must lie between 1 and 86400")
    material = benchmark.read(args.flight, args.start, args.frames, tuple(args.overrides))
    figures = [benchmark.measure(benchmark.resized(material, *size)) for size in args.sizes]
    print(benchmark.table(figures))
    if args.daemon:
        from companion.benchmark import latency, start_up

        measured = [latency.measure(width, height, args.seconds) for width, height in args.sizes]
        print(f"\nthe daemon\n{latency.table(measured)}")
        size = args.sizes[len(args.sizes) // 2]
        print(f"\nits start and end, {size[0]}x{size[1]}\n{start_up.table(start_up.measure(*size))}")
    if args.preview:
        from companion.benchmark import preview_cost

        costs = [preview_cost.measure(width, height) for width, height in args.sizes]
        print("\n" + "\n".join(["previews", *preview_cost.lines(costs)]))
    return 0
