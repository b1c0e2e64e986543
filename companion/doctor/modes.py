"""The flight modes that the settings name, against the list that the autopilot itself gives."""

from collections.abc import Sequence

from companion.doctor.findings import Finding
from companion.settings.settings import LandingSettings
from drivers.autopilot.available_modes import ListedMode

SUBJECT = "flight modes"


def mode_findings(settings: LandingSettings, listed: Sequence[ListedMode] | None) -> list[Finding]:
    """What is wrong with the modes in the settings; nothing where none is named or the autopilot lists none."""
    named = {
        "landing.enable_modes": settings.enable_modes,
        "landing.allowed_modes": settings.allowed_modes,
        "landing.takeover_modes": settings.takeover_modes if settings.procedure == "offboard" else (),
    }
    if not any(named.values()) or listed is None:
        return []
    known = {mode.name: mode for mode in listed}
    found = []
    for path, names in named.items():
        # lists may name the modes of several autopilots
        if names and not any(name in known for name in names):
            text = f"{path}: the autopilot has no mode {', '.join(names)}"
            found.append(Finding(SUBJECT, "failure", text, f"it has {', '.join(sorted(known))}"))
    for name in settings.enable_modes:
        if name in known and not known[name].selectable:
            text = f"landing.enable_modes: {name} cannot be chosen by the pilot now"
            found.append(Finding(SUBJECT, "failure", text, "name a mode that the pilot can switch to"))
    return found or [Finding(SUBJECT, "ok", f"compared with the {len(known)} that the autopilot lists")]
