"""Settings of earlier versions that have another name now, or none: files that name them still load."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Moved:
    """Where a setting went: its path now, empty when nothing takes its place (its value is then ignored)."""

    now: str = ""
    why: str = ""

    @property
    def note(self) -> str:
        """What a user is shown behind the old name."""
        where = f"is now {self.now}" if self.now else "has no effect any more"
        return f"{where}: {self.why}" if self.why else where


MOVED: dict[str, Moved] = {
    "estimator.border_kept_px": Moved(
        why="a doubt at the border of the view lasts for ground.baseline of motion, until the ground is measured"
    ),
}
"""Old path -> where it went. Recorded flights carry all settings of their version, so every name stays here."""
