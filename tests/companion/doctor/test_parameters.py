"""The autopilot's parameters for the landing procedure, read over a real socket and checked."""

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.doctor import parameters
from companion.doctor.findings import DoctorOptions
from companion.doctor.link import LinkExamination
from companion.doctor.parameters import BY_AUTOPILOT, names, parameter_findings
from companion.settings.settings_file import load
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.firmware import Firmware

FIT = {
    ("ardupilot", "offboard"): {"GUID_TIMEOUT": 1.0},
    ("ardupilot", "landing_target"): {
        "PLND_ENABLED": 1,
        "PLND_TYPE": 1,
        "PLND_YAW_ALIGN": 0,
        "PLND_LAND_OFS_X": 0,
        "PLND_LAND_OFS_Y": 0,
        "PLND_XY_DIST_MAX": 2.5,
        "PLND_STRICT": 0,
    },
    ("px4", "offboard"): {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3},
    ("px4", "landing_target"): {"PLD_BTOUT": 5.0, "PLD_HACC_RAD": 0.2},
}
WRONG = [
    ("ardupilot", "offboard", "GUID_TIMEOUT", 3.0, "failure"),
    ("ardupilot", "offboard", "GUID_TIMEOUT", 0.1, "failure"),
    ("ardupilot", "landing_target", "PLND_ENABLED", 0, "failure"),
    ("ardupilot", "landing_target", "PLND_TYPE", 2, "failure"),
    ("ardupilot", "landing_target", "PLND_LAND_OFS_X", 20, "failure"),
    ("ardupilot", "landing_target", "PLND_XY_DIST_MAX", 0, "warning"),
    ("px4", "offboard", "COM_OF_LOSS_T", 5.0, "failure"),
    ("px4", "offboard", "COM_OBL_RC_ACT", 0, "failure"),
    ("px4", "offboard", "COM_OBL_RC_ACT", 7, "failure"),
    ("px4", "offboard", "COM_RC_OVERRIDE", 1, "warning"),
    ("px4", "landing_target", "PLD_HACC_RAD", 1.0, "warning"),
]


def test_every_rule_is_among_the_fit_values_here() -> None:
    for (autopilot, procedure), fit in FIT.items():
        assert tuple(fit) == names(procedure, autopilot)
    assert {(a, p) for a, kinds in BY_AUTOPILOT.items() for p in kinds} == set(FIT)


@pytest.mark.parametrize(("autopilot", "procedure"), FIT)
def test_fit_parameters_are_one_line(autopilot: str, procedure: str) -> None:
    (found,) = parameter_findings(procedure, autopilot, FIT[autopilot, procedure])
    assert found.level == "ok"


@pytest.mark.parametrize(("autopilot", "procedure", "name", "value", "level"), WRONG)
def test_what_is_wrong_is_named_with_its_value_and_the_remedy(
    autopilot, procedure, name, value, level
) -> None:
    (found,) = parameter_findings(procedure, autopilot, FIT[autopilot, procedure] | {name: value})
    assert found.level == level
    assert found.text.startswith(f"{name} is {value:g}: ")
    assert name in found.remedy


@given(st.sampled_from(sorted(FIT)), st.data())
def test_what_was_not_read_is_never_well(kind: tuple[str, str], data: st.DataObject) -> None:
    autopilot, procedure = kind
    missing = data.draw(st.sets(st.sampled_from(sorted(FIT[kind])), min_size=1))
    values = {name: value for name, value in FIT[kind].items() if name not in missing}
    found = parameter_findings(procedure, autopilot, values)
    assert {f.text.split(" ", maxsplit=1)[0] for f in found} == missing
    assert {f.level for f in found} == {"warning"}


def test_another_autopilot_has_no_procedure() -> None:
    (found,) = parameter_findings("offboard", "autopilot 5", {})
    assert found.level == "failure"
    assert parameter_findings("land", "autopilot 5", {}) == []


@pytest.mark.parametrize(
    ("firmware", "procedure", "wrong"),
    [
        (Firmware(), "offboard", ["GUID_TIMEOUT is 3"]),
        (Firmware(), "landing_target", ["PLND_ENABLED is 0", "PLND_TYPE is 0", "PLND_STRICT is 1"]),
        (Firmware("px4"), "offboard", ["COM_OBL_RC_ACT is 0", "COM_RC_OVERRIDE is 1"]),
    ],
)
def test_defaults_of_an_autopilot_are_read_over_the_link(
    firmware: Firmware, procedure: str, wrong: list[str]
) -> None:
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        autopilot.controller.firmware = firmware
        overrides = [f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}", f"landing.procedure={procedure}"]
        examination = LinkExamination(load(None, overrides).settings, DoctorOptions())
        deadline = time.monotonic() + 300
        wanted = set(parameters.names(procedure, firmware.kind)) & set(autopilot.protocol.parameters)
        while not wanted <= examination._parameters.values.keys() and time.monotonic() < deadline:
            examination.look()
            time.sleep(0.05)
        findings = [f for f in examination.findings() if f.subject == "procedure"]
        examination.close()
    read = [f.text.split(":")[0] for f in findings if "could not be read" not in f.text]
    assert read == wrong
