"""Run the experiments of the method's paper again on simulated cameras and write a report with figures.

Every estimator method is measured on the same pictures. The same seed gives the same report.
"""

import argparse
import sys
import time
from pathlib import Path

import cv2

from companion.errors import LandslopeError
from companion.experiments import flatness, handheld, slopes, stairs, zoom
from companion.experiments.measure import METHODS, Job, Outcome
from companion.experiments.report import Section, new_figure, write_report
from drivers.system.pools import Pool, dask, each, processes

AHEAD = 4
"""Sequences handed to each worker in advance."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument(
        "--out", type=Path, default=Path("experiments"), help="folder for the report (experiments)"
    )
    parser.add_argument(
        "--quick", action="store_true", help="a small selection, to see that everything works"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of textures, noise and motion (1)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="on the workers of this Dask scheduler, --jobs of them (needs the extra 'scale')",
    )
    parser.add_argument("--images", type=Path, help="a folder of numbered zoom images to measure as well")
    parser.add_argument(
        "--images-tau", type=float, default=100.0, help="frames to contact of the image numbered 0 (100)"
    )
    parser.add_argument("--images-focal", type=float, default=274.5, help="their focal length in px (274.5)")


def run(args: argparse.Namespace) -> int:
    """Run all experiments and write the report."""
    most = 64 if args.dask is None else 10_000
    if not 1 <= args.jobs <= most:
        raise LandslopeError(f"--jobs must lie between 1 and {most}, got {args.jobs}")
    if args.images is not None and not args.images.is_dir():
        raise LandslopeError(f"--images: {args.images} is not a folder")
    if args.images_focal <= 0 or args.images_tau <= zoom.LAST_TAU:
        raise LandslopeError(f"--images-focal must be positive and --images-tau over {zoom.LAST_TAU}")
    new_figure(1, 1, 1, 1)
    args.out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    groups = {
        "zoom": zoom.jobs(args.quick, args.seed),
        "slopes": slopes.jobs(args.quick, args.seed),
        "handheld": handheld.jobs(args.quick, args.seed),
        "flatness": flatness.jobs(args.quick, args.seed),
        "stairs": stairs.jobs(args.quick, args.seed),
    }
    if args.images is not None:
        images = {"directory": str(args.images), "focal_px": args.images_focal, "tau": args.images_tau}
        groups["images"] = [Job(zoom.folder, images)]
    pool = processes(args.jobs) if args.dask is None else dask(args.dask)
    results = run_jobs(groups, pool, args.jobs)
    sections: list[Section] = [
        zoom.section(results["zoom"], args.out, "Fig. 4: time to contact on zooms", "fig4.png"),
        slopes.section(results["slopes"], args.out),
        handheld.section(results["handheld"], args.out),
        flatness.section(results["flatness"], args.out),
        stairs.section(results["stairs"], args.out),
    ]
    if "images" in results:
        title = f"Fig. 4: time to contact on the images of {args.images.name}"
        sections.insert(1, zoom.section(results["images"], args.out, title, "fig4_images.png"))
    settings = f"Seed {args.seed}, methods {', '.join(METHODS)}" + (
        ", quick selection." if args.quick else "."
    )
    path = write_report(args.out, sections, settings)
    for comparison in (c for s in sections for c in s.comparisons):
        print(f"{comparison.what}\n  paper: {comparison.paper}\n  here:  {comparison.measured}")
    print(f"\n{path} written after {time.perf_counter() - start:.0f} s")
    return 0


def run_jobs(groups: dict[str, list[Job]], pool: Pool, workers: int) -> dict[str, list[Outcome]]:
    """All jobs of all groups, several at a time; the outcomes in the order of the jobs. The first error ends them."""
    numbered = list(enumerate(job for group in groups.values() for job in group))
    outcomes: dict[int, Outcome] = {}
    for (number, _), outcome in each(pool, _work, numbered, AHEAD * workers):
        if isinstance(outcome, BaseException):
            raise outcome
        outcomes[number] = outcome
        if sys.stderr.isatty():
            print(f"\r{len(outcomes)} of {len(numbered)} sequences", end="", file=sys.stderr, flush=True)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    found = (outcomes[number] for number, _ in numbered)
    return {name: [next(found) for _ in group] for name, group in groups.items()}


def _work(numbered: tuple[int, Job]) -> Outcome:
    cv2.setNumThreads(1)
    return numbered[1]()
