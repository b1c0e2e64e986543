"""Random flights over fit ground with something in view: how many still ask.

    python tests/tools/in_view_flights.py skids --kept

``--mask`` gives the mask that the thing asks for as ``camera.mask``; ``--kept`` flies each flight twice, the second
time with what the first one found; ``--unlearnt`` switches the search for still parts off.

Of the seeds from 0 on the first 15 flights over level or gentle ground that ask without anything in view are flown.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from companion.live.kept_mask import KeptMask
from companion.settings.settings import CameraSettings
from companion.simulation.lockstep import LockstepOptions, fly
from companion.simulation.random_scenario import random_scenario
from companion.simulation.scenario import Scenario
from companion.simulation.scene import Scene
from drivers.simulated.world.in_view import IN_VIEW, InView

FLIGHTS = 15
COVERED = 0.03
"""How opaque a pixel is from which a careful user would mask it."""


def with_view(scenario: Scenario, what: str) -> Scenario:
    """The scenario with something in view."""
    return replace(scenario, camera=replace(scenario.camera, in_view=what))


class KeptHere(KeptMask):
    """One file, whatever the calibration is called."""

    def __init__(self, folder: Path) -> None:
        super().__init__(CameraSettings(), folder)


def asks(scenario: Scenario, overrides: tuple[str, ...] = (), kept: KeptMask | None = None) -> bool:
    """Whether a landing is requested."""
    options = LockstepOptions(stop_at_request=True, kept_mask=kept)
    return bool(fly(scenario, None, overrides, options).requests)


def main() -> None:
    """Fly and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=IN_VIEW)
    parser.add_argument("--mask", action="store_true", help="with the mask that the thing in view asks for")
    parser.add_argument("--kept", action="store_true", help="fly twice: the second time with what was found")
    parser.add_argument("--unlearnt", action="store_true", help="without camera.learn_mask")
    parser.add_argument("--flights", type=int, default=FLIGHTS, help=f"how many ({FLIGHTS})")
    args = parser.parse_args()
    asked = flown = 0
    seed = -1
    while flown < args.flights:
        seed += 1
        plain = random_scenario(seed)
        if plain.basics.description not in ("level", "gentle") or plain.faults or not asks(plain):
            continue
        flown += 1
        scenario = with_view(plain, args.what)
        overrides: tuple[str, ...] = ("camera.learn_mask=false",) if args.unlearnt else ()
        with tempfile.TemporaryDirectory() as folder:
            if args.mask:
                cover = InView(args.what, Scene(scenario, threads=False).lens, plain.basics.seed).cover
                if cover is None:
                    parser.error(f"{args.what} does not stay in the picture: there is no mask for it")
                path = Path(folder) / "mask.png"
                cv2.imwrite(str(path), np.where(cover > COVERED, 0, 255).astype(np.uint8))
                overrides += (f"camera.mask={path}",)
            if args.kept:
                asks(scenario, overrides, KeptHere(Path(folder)))
            asked += asks(scenario, overrides, KeptHere(Path(folder)) if args.kept else None)
        print(f"seed {seed}: {asked} of {flown} asked", flush=True)


if __name__ == "__main__":
    main()
