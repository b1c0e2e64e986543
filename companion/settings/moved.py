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


_FIXED = Moved(why="it is a constant of the method now")
_FIXED_TRACKING = (
    "levels",
    "retry_share",
    "levels_unpredicted",
    "warp_min_tracks",
    "warp_from_px",
    "level_px",
    "contrast",
    "max_gain",
    "corner_max_std_px",
    "corner_px",
    "spacing_px",
    "twin_px",
    "renew_below",
    "renew_after_frames",
    "renew_after_cells",
    "forward_backward_max_px",
)
_FIXED_ESTIMATOR = (
    "min_roughness_tracks",
    "noise_floor",
    "noise_cap",
    "map_keep_tracks",
    "map_cut",
    "shared_noise",
    "drift_std_deg",
    "agreement",
    "agreement_alone",
    "overlap",
    "systematic_std_deg",
    "keep_seen",
    "unmeasured_rotation_std_rad",
    "slope_std",
    "restart_below",
    "relief_groups",
    "relief_group_tracks",
    "gross_sigmas",
    "gross_share",
    "quadratic_hypotheses",
    "quadratic_inlier_px",
    "quadratic_flow_px",
    "quadratic_min_flow",
    "quadratic_min_divergence",
)

_DROP_OFF = ("sigmas", "floor", "tracks", "share")

MOVED: dict[str, Moved] = {
    **{f"tracking.{name}": _FIXED for name in _FIXED_TRACKING},
    **{f"estimator.{name}": _FIXED for name in _FIXED_ESTIMATOR},
    "estimator.border_unlike": Moved("estimator.appearance_change"),
    "estimator.border_unlike_sigmas": Moved("estimator.appearance_change_sigmas"),
    **{f"estimator.brink_{name}": Moved(f"estimator.drop_off_{name}") for name in _DROP_OFF},
    "tracking.blur_px": Moved(why="pictures are not blurred before tracking"),
    "estimator.border_kept_px": Moved(
        why="a doubt at the border of the view lasts for ground.baseline of motion, until the ground is measured"
    ),
}
"""Old path -> where it went. Recorded flights carry all settings of their version, so every name stays here."""
