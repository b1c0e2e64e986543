"""What a simulated flight is made of: the TOML file that users write, typed and bounded like the settings."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from companion.errors import SettingsError
from companion.settings.marks import Meaning
from companion.settings.settings import Settings
from companion.settings.settings_file import load, read_section
from companion.settings.toml_text import parse_toml, written
from drivers.errors import DriverError
from drivers.simulated.world.world import World, build_world
from landing.options import Limits

ENABLE_CHANNEL = 8
"""Radio channel of the simulated pilot's switch."""
TABLES = ("surface", "leg", "fault")
"""Names of the lists of tables in a scenario."""


@dataclass(frozen=True, slots=True)
class CameraScene:
    """The simulated camera and its faults."""

    width_px: Annotated[int, Limits(64, 1920, "px", "width of the image")] = 320
    height_px: Annotated[int, Limits(48, 1200, "px", "height of the image")] = 240
    fov_deg: Annotated[float, Limits(20, 120, "deg", "field of view across the image")] = 64.0
    lens: Annotated[
        Literal["pinhole", "equidistant"], Meaning("the projection; equidistant is a fisheye lens")
    ] = "pinhole"
    distortion: Annotated[
        tuple[float, ...], Meaning("k1, k2, p1, p2, k3 as OpenCV has them; equidistant: k1 to k4")
    ] = ()
    rate_hz: Annotated[float, Limits(1, 120, "Hz", "frames a second")] = 20.0
    latency_s: Annotated[float, Limits(0, 2, "s", "from exposure to arrival")] = 0.02
    late_s: Annotated[float, Limits(-0.1, 2, "s", "how late the stamps are")] = 0.0
    late_known: Annotated[bool, Meaning("whether camera.time_offset_s is set to that")] = True
    mount_roll_deg: Annotated[float, Limits(-45, 45, "deg", "camera's roll in the body frame")] = 0.0
    mount_pitch_deg: Annotated[float, Limits(-45, 45, "deg", "camera's pitch in the body frame")] = 0.0
    mount_yaw_deg: Annotated[float, Limits(-180, 180, "deg", "camera's yaw in the body frame")] = 0.0
    noise: Annotated[float, Limits(0, 50, "grey levels", "sensor noise, one sigma")] = 2.0
    vignetting: Annotated[float, Limits(0, 1, "", "loss of light in the corners")] = 0.1
    exposure_drift: Annotated[float, Limits(0, 0.9, "", "slow relative change of brightness")] = 0.05
    exposure_s: Annotated[float, Limits(0, 0.1, "s", "exposure time; blurs by motion")] = 0.0
    readout_s: Annotated[float, Limits(0, 0.1, "s", "rolling shutter, first row to last")] = 0.0
    readout_known: Annotated[bool, Meaning("whether camera.readout_s is set to that")] = True
    brightness: Annotated[float, Limits(0.02, 4, "", "light, 1 is good")] = 1.0
    contrast: Annotated[float, Limits(0.02, 4, "", "contrast, 1 is good")] = 1.0
    mirrored: Annotated[bool, Meaning("whether left and right are swapped in the pictures")] = False
    focal_believed: Annotated[float, Limits(0.3, 3, "", "calibrated over true focal length")] = 1.0
    in_view: Annotated[
        Literal["nothing", "skids", "shadow", "dirt", "person"],
        Meaning(
            "in the picture beside the ground: the vehicle's skids, its shadow, dirt, a person who walks by"
        ),
    ] = "nothing"


@dataclass(frozen=True, slots=True)
class StartScene:
    """Where the flight begins."""

    north_m: Annotated[float, Limits(-500, 500, "m", "place in the world")] = 0.0
    east_m: Annotated[float, Limits(-500, 500, "m", "place in the world")] = 0.0
    height_m: Annotated[float, Limits(0, 120, "m", "over the ground; 0: standing, takes off")] = 2.0
    take_off_m: Annotated[float, Limits(0.5, 50, "m", "height of a takeoff")] = 2.0
    heading_deg: Annotated[float, Limits(-180, 360, "deg", "nose's bearing")] = 0.0
    mode: Annotated[Literal["GUIDED", "LOITER"], Meaning("flight mode reported to the companion")] = "GUIDED"


@dataclass(frozen=True, slots=True)
class WindScene:
    """The air."""

    speed_m_s: Annotated[float, Limits(0, 20, "m/s", "mean wind")] = 0.0
    towards_deg: Annotated[float, Limits(-180, 360, "deg", "bearing the air moves to")] = 0.0
    gust_m_s: Annotated[float, Limits(0, 10, "m/s", "standard deviation of the gusts")] = 0.0
    shake_rad_s: Annotated[float, Limits(0, 1, "rad/s", "turbulence's body rates, one sigma")] = 0.0


@dataclass(frozen=True, slots=True)
class SensorScene:
    """What the autopilot gets wrong, one sigma."""

    gyro_noise_rad_s: Annotated[float, Limits(0, 0.5, "rad/s", "noise of a reading")] = 0.004
    gyro_bias_rad_s: Annotated[float, Limits(0, 0.1, "rad/s", "constant of a flight")] = 0.001
    attitude_error_deg: Annotated[float, Limits(0, 10, "deg", "wandering error of roll and pitch")] = 0.15
    velocity_noise_m_s: Annotated[float, Limits(0, 2, "m/s", "noise")] = 0.03
    velocity_error_m_s: Annotated[float, Limits(0, 2, "m/s", "wandering error")] = 0.05
    velocity_lag_s: Annotated[float, Limits(0, 2, "s", "time constant of a slow filter")] = 0.0
    velocity_scale: Annotated[float, Limits(0, 10, "", "of the reported velocity; 0: always zero")] = 1.0
    velocity_told: Annotated[bool, Meaning("whether LOCAL_POSITION_NED comes at all")] = True


@dataclass(frozen=True, slots=True)
class LinkScene:
    """The cable between autopilot and companion."""

    delay_min_s: Annotated[float, Limits(0, 0.2, "s", "shortest delay of a message")] = 0.001
    delay_max_s: Annotated[float, Limits(0, 0.2, "s", "longest delay of a message")] = 0.009
    loss: Annotated[float, Limits(0, 0.9, "", "share of messages lost")] = 0.0
    telemetry_rate_hz: Annotated[float, Limits(5, 400, "Hz", "ATTITUDE and RAW_IMU (lockstep only)")] = 100.0
    since_boot_s: Annotated[float, Limits(1, 5e6, "s", "age of the autopilot at the start")] = 30.0
    land_answer: Annotated[
        Literal["normal", "accepted", "denied", "temporarily_rejected", "in_progress_then_accepted",
                "in_progress_then_silence", "no_answer", "answer_lost"],
        Meaning("how NAV_LAND is answered"),
    ] = "normal"  # fmt: skip


@dataclass(frozen=True, slots=True)
class Leg:
    """A piece of the flight; forward and right follow the heading."""

    seconds: Annotated[float, Limits(0.1, 600, "s", "how long")] = 5.0
    forward_m_s: Annotated[float, Limits(-8, 8, "m/s", "speed forward")] = 0.0
    right_m_s: Annotated[float, Limits(-8, 8, "m/s", "speed to the right")] = 0.0
    climb_m_s: Annotated[float, Limits(-3, 3, "m/s", "speed upwards, where no height is held")] = 0.0
    height_m: Annotated[float, Limits(0, 120, "m", "height held over the ground below; 0: none")] = 0.0
    turn_deg_s: Annotated[float, Limits(-90, 90, "deg/s", "rate of turn")] = 0.0


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong in flight."""

    kind: Annotated[
        Literal["camera_frozen", "camera_looped", "camera_to_and_fro", "camera_lost", "camera_dark", "link_silent",
                "autopilot_reboot", "mode_change"],
        Meaning("what"),
    ] = "camera_frozen"  # fmt: skip
    at_s: Annotated[float, Limits(0, 3600, "s", "when it begins")] = 5.0
    seconds: Annotated[float, Limits(0, 3600, "s", "how long it lasts")] = 1.0
    mode: Annotated[Literal["LOITER", "BRAKE", "RTL", "ALT_HOLD"], Meaning("of a mode_change")] = "LOITER"
    loop_s: Annotated[float, Limits(0.1, 60, "s", "of pictures that are looped or run to and fro")] = 1.0

    def active(self, time_s: float) -> bool:
        """Whether it is going wrong at this time of the flight."""
        return self.at_s <= time_s < self.at_s + self.seconds


@dataclass(frozen=True, slots=True)
class PilotScene:
    """The pilot's switch that enables landings (radio channel 8 of the simulated vehicle)."""

    switch_on_s: Annotated[
        float, Limits(0.5, 3600, "s", "when it is turned on; before, landings are not allowed")
    ] = 0.5


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a good system does; a flight that ends otherwise fails."""

    landing: Annotated[
        Literal["any", "requested", "none"], Meaning("whether a landing shall be requested")
    ] = "any"
    min_north_m: Annotated[float, Limits(-1000, 1000, "m", "of the touchdown")] = -1000.0
    max_north_m: Annotated[float, Limits(-1000, 1000, "m", "of the touchdown")] = 1000.0


@dataclass(frozen=True, slots=True)
class Basics:
    """The top of the file."""

    description: str = ""
    seed: Annotated[int, Limits(0, 2**31 - 1, "", "of everything random")] = 1
    duration_s: Annotated[float, Limits(1, 3600, "s", "the flight's end, unless it has landed before")] = 60.0
    texture_seed: Annotated[int, Limits(0, 1000, "", "of the ground's textures")] = 1


@dataclass(frozen=True, slots=True)
class Scenario:
    """One simulated flight."""

    name: str
    basics: Basics = field(default_factory=Basics)
    camera: CameraScene = field(default_factory=CameraScene)
    start: StartScene = field(default_factory=StartScene)
    wind: WindScene = field(default_factory=WindScene)
    sensors: SensorScene = field(default_factory=SensorScene)
    link: LinkScene = field(default_factory=LinkScene)
    pilot: PilotScene = field(default_factory=PilotScene)
    expect: Expectation = field(default_factory=Expectation)
    surfaces: tuple[dict[str, Any], ...] = ({"kind": "level"},)
    legs: tuple[Leg, ...] = ()
    faults: tuple[Fault, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    """Settings of landslope that the scenario flies with, as nested tables."""

    def world(self) -> World:
        """The ground; SettingsError for a surface that cannot be built."""
        try:
            return build_world(list(self.surfaces))
        except DriverError as error:
            raise SettingsError(f"{self.name}: {error}") from None

    def flight_settings(self, config: Path | None, overrides: Sequence[str] = ()) -> Settings:
        """The settings in force: a file's, the scenario's over it, the camera's truth, then ``overrides``."""
        camera = self.camera
        known = [
            f"camera.mount_roll_deg={camera.mount_roll_deg}",
            f"camera.mount_pitch_deg={camera.mount_pitch_deg}",
            f"camera.mount_yaw_deg={camera.mount_yaw_deg}",
            f"landing.enable_rc_channel={ENABLE_CHANNEL}",
        ]
        if camera.readout_known:
            known.append(f"camera.readout_s={camera.readout_s}")
        if camera.late_known:
            known.append(f"camera.time_offset_s={camera.late_s}")
        return load(config, [*known, *_assignments(self.settings), *overrides]).settings


_SECTIONS = {
    "camera": CameraScene,
    "start": StartScene,
    "wind": WindScene,
    "sensors": SensorScene,
    "link": LinkScene,
    "pilot": PilotScene,
    "expect": Expectation,
}


def built_in() -> dict[str, str]:
    """Names of the scenarios that come with landslope, and what they are."""
    folder = resources.files("companion.simulation") / "scenarios"
    names = sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml"))
    return {name: read_scenario(name).basics.description for name in names}


def read_scenario(name: str) -> Scenario:
    """A scenario by name or by the path of its file. Raises SettingsError with a line for every fault."""
    path = Path(name)
    if path.suffix == ".toml":
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SettingsError(f"{name}: the scenario cannot be read: {error}") from None
        return parse_scenario(path.stem, text, name)
    file = resources.files("companion.simulation") / "scenarios" / f"{name}.toml"
    if not file.is_file():
        raise SettingsError(
            f"there is no scenario '{name}'; give a .toml file or one of {', '.join(_built_in_names())}"
        )
    return parse_scenario(name, file.read_text(encoding="utf-8"), f"{name}.toml")


def parse_scenario(name: str, text: str, where: str) -> Scenario:
    """A scenario from its TOML text; ``where`` begins the lines of errors."""
    table = parse_toml(text, where)
    faults: list[str] = []
    parts: dict[str, Any] = {}

    def part(key: str, kind: type, content: Any, place: str) -> Any:
        if not isinstance(content, dict):
            faults.append(f"{place}: must be a table")
            return None
        try:
            return read_section(kind, content, place)
        except SettingsError as error:
            faults.extend(str(error).split("\n"))
            return None

    for key, kind in _SECTIONS.items():
        parts[key] = part(key, kind, table.pop(key, {}), f"{where} [{key}]")
    lists = {key: table.pop(key, []) for key in TABLES}
    for key, content in lists.items():
        if not isinstance(content, list) or not all(isinstance(entry, dict) for entry in content):
            faults.append(f"{where}: write every {key} as [[{key}]]")
            lists[key] = []
    settings = table.pop("settings", {})
    legs = [part("leg", Leg, entry, f"{where} leg {i}") for i, entry in enumerate(lists["leg"], 1)]
    flaws = [part("fault", Fault, entry, f"{where} fault {i}") for i, entry in enumerate(lists["fault"], 1)]
    basics = part("", Basics, table, where)
    if faults:
        raise SettingsError("\n".join(faults))
    scenario = Scenario(
        name=name,
        basics=basics,
        **parts,
        surfaces=tuple(lists["surface"]) or ({"kind": "level"},),
        legs=tuple(legs),
        faults=tuple(flaws),
        settings=settings,
    )
    scenario.world()
    scenario.flight_settings(None)
    return scenario


def to_toml(scenario: Scenario) -> str:
    """The scenario as the text of its file."""
    lines = [f"{name} = {written(value)}" for name, value in asdict(scenario.basics).items()]
    lines += _tables("settings", scenario.settings)
    for name in _SECTIONS:
        lines += _tables(name, asdict(getattr(scenario, name)))
    lists: tuple[tuple[str, list[dict[str, Any]]], ...] = (
        ("surface", [dict(s) for s in scenario.surfaces]),
        ("leg", [asdict(leg) for leg in scenario.legs]),
        ("fault", [asdict(fault) for fault in scenario.faults]),
    )
    for name, entries in lists:
        for entry in entries:
            lines += ["", f"[[{name}]]", *(f"{key} = {written(value)}" for key, value in entry.items())]
    return "\n".join(lines) + "\n"


def _tables(name: str, table: dict[str, Any]) -> list[str]:
    """A table and the tables in it."""
    plain = {k: v for k, v in table.items() if not isinstance(v, dict)}
    lines = ["", f"[{name}]", *(f"{key} = {written(value)}" for key, value in plain.items())] if plain else []
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _tables(f"{name}.{key}", value)
    return lines


def _built_in_names() -> list[str]:
    folder = resources.files("companion.simulation") / "scenarios"
    return sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml"))


def _assignments(table: dict[str, Any], prefix: str = "") -> Iterator[str]:
    """Nested tables as ``section.key=value``."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _assignments(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}={written(value)}"
