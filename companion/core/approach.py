"""The landing procedure in the core: its inputs from ground map, estimate and consent, its orders out."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.core.consent import Consent
from companion.messages.events import event
from companion.messages.messages import Event, ProcedureState
from companion.settings.settings import Settings
from landing.decision.decision import against_motion
from landing.decision.ground_level import GroundLevel
from landing.decision.lean import Lean
from landing.decision.orders import (
    NOT_SEEN,
    GroundMotion,
    Inputs,
    Order,
    OrderKind,
    State,
    Step,
    Vector,
)
from landing.decision.procedure import Procedure
from landing.decision.procedure_options import ProcedureOptions
from landing.decision.targeting import Targeting
from landing.decision.withheld import Withheld
from landing.estimate import SurfaceEstimate
from landing.ground.ground import Ground
from landing.reasons import CONTRADICTIONS
from landing.rotations import euler_from_matrix
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

SPOTS_EVERY_S = 0.2
"""All discs are looked at this often; the chosen one at every frame."""
VELOCITY_MAX_AGE_S = 0.5
NEAR_M = 0.8
"""Ground so near, and as far as it flies in a second, is flown over with room."""
MOVES_SIGMAS = 2.0
"""Standard deviations by which the ground must be faster than is landed on, for it to move clearly."""
BESIDE_M = 0.1
"""Ground beside the disc that the view must hold as well."""


@dataclass(frozen=True, slots=True)
class Ordered:
    """An order of the procedure, at a frame or between frames. ``time_unix_us``: companion clock, as stamped."""

    frame: int
    time_unix_us: int
    step: Step

    @property
    def order(self) -> Order:
        """What is asked of the autopilot."""
        return self.step.order


def hand_over_height(camera: CameraModel, radius_m: float) -> float:
    """Height below which the view of a level vehicle no longer holds the disc of that radius straight below, m.

    From where the four borders of the picture meet the ground; infinite for a camera that does not see straight down.
    """
    reach = math.inf
    width, height = camera.width, camera.height
    for pixel, axis, sign in (
        ((0.0, height / 2), 0, -1.0),
        ((width - 1.0, height / 2), 0, 1.0),
        ((width / 2, 0.0), 1, -1.0),
        ((width / 2, height - 1.0), 1, 1.0),
    ):
        x, y = camera.undistort(np.array([pixel]))[0]
        down = camera.body_from_camera @ (x, y, 1.0)
        if not down[2] > 0:
            continue
        # along the picture's own direction, as it lies in the body's level plane
        way = camera.body_from_camera[:2, axis] * sign
        size = math.hypot(*way)
        reach = min(reach, float(way @ down[:2]) / size / down[2]) if size > 0 else 0.0
    return (radius_m + BESIDE_M) / reach if reach > 0 else math.inf


class Approach:
    """Keeps the procedure that the settings name. ``place``, ``local``: see ``Inputs``."""

    def __init__(self, settings: Settings, camera: CameraModel, ground: Ground, consent: Consent) -> None:
        landing, vehicle = settings.landing, settings.vehicle
        self.kind = landing.procedure
        options = ProcedureOptions(
            takeover_modes=frozenset(landing.takeover_modes) if self.kind == "offboard" else frozenset(),
            divergence=landing.descent_divergence,
            max_speed=landing.max_speed_m_s,
            max_search_m=vehicle.max_search_m,
            max_time_s=landing.max_time_s,
            hand_over_m=max(0.5, hand_over_height(camera, vehicle.landing_radius_m)),
        )
        self._machine: Procedure | Targeting = (
            Procedure(options) if self.kind == "offboard" else Targeting(options)
        )
        self._ground, self._consent = ground, consent
        self._decision = settings.decision
        self._level, self._lean = GroundLevel(), Lean()
        self._spots_s, self._yaw = -math.inf, math.nan
        self._local: tuple[int, Vector] | None = None
        self._reported: Step | None = None

    @property
    def state(self) -> ProcedureState | None:
        """For the decision's message."""
        step = self._reported
        if step is None:
            return None
        vehicle, spot = self._ground.sight.place_ned, step.spot_ned
        north = east = ahead = right = None
        if spot is not None:
            north, east = round(spot[0] - vehicle[0], 3), round(spot[1] - vehicle[1], 3)
            cos, sin = math.cos(self._yaw), math.sin(self._yaw)
            if math.isfinite(cos):
                ahead, right = round(cos * north + sin * east, 3), round(cos * east - sin * north, 3)
        return ProcedureState(
            kind=self.kind,
            state=step.state.value,
            code=step.why.value,
            text=step.words,
            order=step.order.kind.value,
            velocity_ned=_rounded(step.order.velocity_ned) if step.order.kind is OrderKind.VELOCITY else None,
            spot_north_m=north,
            spot_east_m=east,
            spot_ahead_m=ahead,
            spot_right_m=right,
        )

    def locate(self, position_ned: Vector, now_us: int) -> None:
        """The autopilot's LOCAL_POSITION_NED."""
        self._local = now_us, position_ned

    def see(
        self, estimate: SurfaceEstimate, attitude: Array | None, now_us: int, time_unix_us: int, *, busy: bool
    ) -> list[Event | Ordered]:
        """Take a frame; ``attitude`` is ned_from_body (3, 3) then. ``busy``: a command to land is under way."""
        ground, sight, local = self._ground, self._ground.sight, self._fresh_local(now_us)
        velocity = None if sight.velocity_ned is None else np.array(sight.velocity_ned)
        self._lean.step(estimate.time_s, attitude, velocity)
        self._yaw = math.nan if attitude is None else euler_from_matrix(attitude)[2]
        spots = None
        if self._machine.wants_spots and estimate.time_s - self._spots_s >= SPOTS_EVERY_S:
            self._spots_s, spots = estimate.time_s, ground.spots(self._lean.drift_m)
        place = self._machine.spot_ned
        speed = math.nan if velocity is None else math.hypot(*velocity[:2])
        self._level.step(estimate.time_s, local, sight.approach, sight.seen_m, sight.seen_std_m)
        height_m = self._level.height_m
        # the map is in the metres of the view's own height
        clear = ground.clear_m(NEAR_M + (speed if math.isfinite(speed) else 0.0)) / sight.height_m
        inputs = Inputs(
            time_s=estimate.time_s,
            objections=self._objections(now_us),
            mode=self._mode(now_us),
            quiet=self._quiet(now_us),
            landing=busy,
            contradictions=(str(estimate.status),) if estimate.status in CONTRADICTIONS else (),
            place_ned=sight.place_ned,
            local_ned=local,
            velocity_ned=sight.velocity_ned if local is not None else None,
            yaw=self._yaw,
            height_m=height_m,
            clear_m=clear * height_m,
            approach=sight.approach,
            ground_motion=self._ground_motion(estimate),
            below=ground.at(*sight.place_ned[:2]),
            spots=spots,
            at_spot=NOT_SEEN if place is None else ground.at(*place[:2]),
        )
        return self._take(self._machine.step(inputs), estimate.frame, time_unix_us)

    def watch(self, frame: int, now_us: int, time_unix_us: int, time_s: float) -> list[Event | Ordered]:
        """Between frames: what ends it."""
        step = self._machine.watch(time_s, self._objections(now_us), self._mode(now_us), self._quiet(now_us))
        return [] if step is None else self._take(step, frame, time_unix_us)

    def _take(self, step: Step, frame: int, time_unix_us: int) -> list[Event | Ordered]:
        reported, self._reported = self._reported, step
        if step.order.kind is OrderKind.START:
            self._consent.permission.use()
        out: list[Event | Ordered] = []
        if reported is None or reported.state is not step.state:
            name = "procedure_gave_back" if step.state is State.GIVE_BACK else "procedure_changed"
            details = {"state": step.state.value, "code": step.why.value}
            out.append(event(name, frame, time_unix_us, f"landing procedure {step.words}", details))
        was = reported.order.kind if reported is not None else OrderKind.NONE
        if step.order.kind is not OrderKind.NONE or was is not OrderKind.NONE:
            out.append(Ordered(frame, time_unix_us, step))
        return out

    def _ground_motion(self, estimate: SurfaceEstimate) -> GroundMotion:
        o = self._decision
        if not against_motion(estimate, o):
            return GroundMotion.AT_REST
        plain = estimate.ground_speed_m_s - MOVES_SIGMAS * estimate.ground_speed_std_m_s
        if plain > o.max_ground_speed_m_s:
            return GroundMotion.MOVES
        return GroundMotion.UNKNOWN if o.at_rest_known else GroundMotion.AT_REST

    def _objections(self, now_us: int) -> tuple[Withheld, ...]:
        return tuple(o.code for o in self._consent.objections(now_us, command_busy=False))

    def _mode(self, now_us: int) -> str | None:
        return self._consent.vehicle.mode if self._consent.heard(now_us) else None

    def _quiet(self, now_us: int) -> bool:
        v = self._consent.vehicle
        return not self._consent.heard(now_us) or v.failsafe is not False or self._consent.radio_lost

    def _fresh_local(self, now_us: int) -> Vector | None:
        if self._local is None or now_us - self._local[0] > VELOCITY_MAX_AGE_S * 1e6:
            return None
        return self._local[1]


def _rounded(v: Vector) -> Vector:
    return round(v[0], 3), round(v[1], 3), round(v[2], 3)
