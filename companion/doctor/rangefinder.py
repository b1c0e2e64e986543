"""The rangefinder before a flight: does it report, and within its limits."""

from collections.abc import Sequence

from companion.doctor.findings import Finding
from drivers.samples import Distance, Sample


def rangefinder_findings(wanted: bool, samples: Sequence[Sample]) -> list[Finding]:
    """What is to say of the distances among the samples; ``wanted``: ``vehicle.rangefinder`` is set."""
    heard = [sample for sample in samples if isinstance(sample, Distance)]
    if not heard:
        if not wanted:
            return []
        remedy = "check RNGFNDn_TYPE and RNGFNDn_ORIENT (25, down), or set vehicle.rangefinder = false"
        return [Finding("rangefinder", "warning", "no DISTANCE_SENSOR that looks down", remedy)]
    newest = heard[-1]
    now = "nothing in reach" if newest.distance_m is None else f"{newest.distance_m:.2f} m"
    text = f"{now}, measures from {newest.min_m:g} to {newest.max_m:g} m"
    if not wanted:
        return [Finding("rangefinder", "ok", f"{text}; not used, see vehicle.rangefinder")]
    if not newest.min_m < newest.max_m:
        return [
            Finding("rangefinder", "warning", text, "set its limits in the autopilot, RNGFNDn_MIN and MAX")
        ]
    return [Finding("rangefinder", "ok", text)]
