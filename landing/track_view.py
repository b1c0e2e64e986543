"""The tracks behind an estimate, for pictures."""

import math

import numpy as np

from landing.estimate import TrackView
from landing.ground.roughness import Relief
from landing.plane.plane import Plane
from landing.vision.tracking import FeatureTracker


def track_view(tracker: FeatureTracker, plane: Plane, relief: Relief | None, limit: float) -> TrackView:
    """Where the tracks are and were, and which move as the plane says.

    Those without a place in the plane's baseline do so when they are no higher than ``limit``, over the distance.
    """
    everywhere = np.full(len(tracker.alive), math.nan)
    slots, inlier = plane.slots, plane.inlier
    if relief is not None:
        everywhere[relief.slots] = relief.height
        # tracks too young for the plane's baseline show their height over a shorter one
        new = np.isfinite(everywhere)
        new[slots] = False
        younger = new.nonzero()[0]
        slots = np.concatenate((slots, younger))
        inlier = np.concatenate((inlier, np.abs(everywhere.take(younger)) <= limit))
    if not len(slots):
        slots = tracker.alive.nonzero()[0]
        inlier = np.zeros(len(slots), bool)
    gap = min(plane.gap or 1, tracker.longest())
    now = tracker.pixels.take(slots, 0).astype(np.float64)
    before = tracker.pixel_history[(tracker.frame - gap) % tracker.HISTORY].take(slots, 0)
    there = (tracker.born.take(slots) <= tracker.frame - gap)[:, None]
    return TrackView(np.where(there, before, now), now, inlier, everywhere.take(slots))
