"""The gate before the command: every condition for requesting a landing, each with its words."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PermitInputs:
    """What the gate looks at. None means unknown, which counts against landing."""

    time_s: float
    verdict_fit: bool
    enabled: bool
    armed: bool | None
    in_air: bool | None
    mode_allowed: bool | None
    fresh: bool
    stale: tuple[str, ...] = ()
    command_busy: bool = False
    forbidden: tuple[str, ...] = ()
    """Conditions that forbid a landing by themselves, in words."""


@dataclass(frozen=True, slots=True)
class PermitState:
    """``permitted``: a request would go out for a fit surface; ``request``: it goes out now."""

    permitted: bool
    withheld: tuple[str, ...]
    request: bool


class Permit:
    """At most one request per permission; only a new permission by the user opens the gate again."""

    def __init__(self) -> None:
        self._requested = False

    @property
    def requested(self) -> bool:
        """Whether a landing was requested under the present permission."""
        return self._requested

    def step(self, inputs: PermitInputs) -> PermitState:
        """Judge the present moment; ``request`` is true at most once until ``enabled`` was false again."""
        if not inputs.enabled:
            self._requested = False
        withheld = list(inputs.forbidden)
        if not inputs.enabled:
            withheld.append("landing is not enabled")
        if inputs.armed is not True:
            withheld.append("vehicle not armed" if inputs.armed is False else "not known whether armed")
        if inputs.in_air is not True:
            withheld.append(
                "vehicle not in the air" if inputs.in_air is False else "not known whether in the air"
            )
        if inputs.mode_allowed is not True:
            withheld.append(
                "flight mode not allowed" if inputs.mode_allowed is False else "flight mode unknown"
            )
        if not inputs.fresh:
            withheld.append("stale inputs" + (": " + ", ".join(inputs.stale) if inputs.stale else ""))
        if inputs.command_busy:
            withheld.append("a command is under way")
        if self._requested:
            withheld.append("already requested under this permission")
        permitted = not withheld
        request = permitted and inputs.verdict_fit
        if request:
            self._requested = True
        return PermitState(permitted, tuple(withheld), request)
