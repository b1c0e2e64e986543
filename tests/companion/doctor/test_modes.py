"""Modes in the settings against the list that the autopilot gives, read over a real socket."""

import time

import pytest

from companion.doctor.findings import DoctorOptions
from companion.doctor.link import LinkExamination
from companion.doctor.modes import mode_findings
from companion.settings.settings import LandingSettings
from companion.settings.settings_file import load
from drivers.autopilot.available_modes import ListedMode
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.firmware import Firmware

LISTED = (
    ListedMode("LOITER", "Loiter", True),
    ListedMode("ALT_HOLD", "", True),
    ListedMode("ORBIT", "", False),
)


def levels(**settings):
    settings = {"allowed_modes": (), **settings}
    return [f.level for f in mode_findings(LandingSettings(**settings), LISTED)]


def test_modes_that_the_autopilot_lacks_or_the_pilot_cannot_choose_are_named():
    assert levels(enable_modes=("LOITER",), allowed_modes=("LOITER", "HOLD")) == ["ok"]
    assert levels(enable_modes=("POSCTL",)) == ["failure"]
    assert levels(enable_modes=("LOITER", "POSCTL")) == ["ok"]
    assert levels(enable_modes=("ORBIT",)) == ["failure"]
    assert levels(enable_modes=("LOITER",), allowed_modes=("POSCTL", "HOLD")) == ["failure"]
    assert levels(takeover_modes=("POSCTL",), allowed_modes=("LOITER",)) == ["ok"]
    assert levels(procedure="offboard", takeover_modes=("POSCTL",)) == ["failure"]


def test_no_list_and_no_mode_in_the_settings_find_nothing():
    assert mode_findings(LandingSettings(enable_modes=("POSCTL",)), None) == []
    assert levels(enable_modes=()) == []


@pytest.mark.parametrize(
    ("kind", "mode", "level"),
    [("ardupilot", "LOITER", "ok"), ("ardupilot", "POSCTL", "failure"), ("px4", "POSCTL", "ok")],
)
def test_the_list_is_read_over_the_link(kind, mode, level):
    with SimulatedAutopilot("tcp:127.0.0.1:0") as autopilot:
        autopilot.controller.firmware = Firmware(kind)
        overrides = [f"mavlink.connection=tcp:127.0.0.1:{autopilot.port}", f"landing.enable_modes=['{mode}']"]
        examination = LinkExamination(load(None, overrides).settings, DoctorOptions())
        deadline = time.monotonic() + 300
        while examination._modes.modes() is None and time.monotonic() < deadline:
            examination.look()
            time.sleep(0.05)
        findings = [f for f in examination.findings() if f.subject == "flight modes"]
        examination.close()
    assert [f.level for f in findings] == [level]
