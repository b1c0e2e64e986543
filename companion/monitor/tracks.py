"""The tracks over the preview picture, as SVG: relief as colour, outliers as orange crosses.

In: a ``Preview`` message (tracks in pixels of the raw image). Out: SVG elements, and the numbers of tracks as text.
"""

import itertools
import math

from companion.messages.preview import Preview

INLIER, OUTLIER = "#00e05a", "#ff9f1a"
LEVEL, LOW, HIGH = (0, 224, 90), (50, 120, 255), (255, 40, 40)
RELIEF = 0.04
"""Height above the plane divided by the distance, from which a colour is full."""
LARGEST_PX = 100_000.0
MOST_TRACKS = 1000


def tracks_svg(preview: Preview) -> str:
    """SVG in the raw image's pixels; only finite numbers of the message go in, never its texts."""
    stroke = max(1.0, preview.width / 320)
    paths: dict[bool, list[str]] = {True: [], False: []}
    dots: list[str] = []
    relief = itertools.chain(preview.relief, itertools.repeat(None))
    for (x0, y0, x1, y1), inlier, height in list(
        zip(preview.tracks[:MOST_TRACKS], preview.inlier, relief, strict=False)
    ):
        if not all(math.isfinite(v) and abs(v) < LARGEST_PX for v in (x0, y0, x1, y1)):
            continue
        paths[inlier].append(f"M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}")
        if inlier:
            dots.append(
                f'<circle cx="{x1:.1f}" cy="{y1:.1f}" r="{2.2 * stroke:.1f}" fill="{_colour(height)}"/>'
            )
        else:
            r = 2.2 * stroke
            paths[False].append(
                f"M{x1 - r:.1f} {y1 - r:.1f}l{2 * r:.1f} {2 * r:.1f}m0 {-2 * r:.1f}l{-2 * r:.1f} {2 * r:.1f}"
            )
    lines = "".join(
        f'<path d="{"".join(paths[kind])}" stroke="{colour}" stroke-width="{stroke:.1f}" fill="none"/>'
        for kind, colour in ((True, INLIER), (False, OUTLIER))
    )
    return lines + "".join(dots)


def _colour(height: float | None) -> str:
    """Blue for what lies lower than the plane, green on it or unknown, red higher."""
    if height is None or not math.isfinite(height):
        return INLIER
    share, end = min(1.0, abs(height) / RELIEF), HIGH if height > 0 else LOW
    return "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(LEVEL, end, strict=True))


def counts(preview: Preview) -> str:
    """How many of each, in words."""
    inliers = sum(preview.inlier)
    return f"frame {preview.frame}: {inliers} inliers, {len(preview.inlier) - inliers} outliers"
