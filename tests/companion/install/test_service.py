"""The unit file under a real systemd: starts, is fed, is restarted when it hangs, stops in time, and runs sandboxed."""

import tomllib

import nspawn_support
import pytest

from companion.cli import main

SETTINGS = """
[camera]
source = "/opt/landslope-source/sitl_logs/stairs_a"
[mavlink]
connection = "udpin:127.0.0.1:14550"
[record]
directory = "/var/lib/landslope/flights"
when = "always"
min_free_mb = 1
"""

SCRIPT = r"""
cd /opt/landslope-test
show() { systemctl show landslope -p "$1" --value; }
note() { echo "$1 = \"$2\"" >> results.toml; }
systemd-sysusers
systemctl start landslope || { note start failed; journalctl -u landslope --no-pager > journal.txt; exit 0; }
note start 0
note active "$(show ActiveState)"
first=$(show MainPID)
note user "$(stat -c %U /proc/$first)"
for k in $(seq 600); do
    [ -n "$(show StatusText)" ] && [ -n "$(ls /var/lib/landslope/flights)" ] && break
    sleep 0.1
done
note status "$(show StatusText | tr -d '"')"
note alive "$(show ActiveState)"
note restarts_before "$(show NRestarts)"
kill -STOP "$first"
for k in $(seq 1000); do
    sleep 0.1
    second=$(show MainPID)
    [ "$second" != "$first" ] && [ "$second" != 0 ] && [ "$(show ActiveState)" = active ] && break
done
note restarts_after "$(show NRestarts)"
note active_again "$(show ActiveState)"
note result "$(show Result)"
systemctl stop landslope
note exit_status "$(show ExecMainStatus)"
note state_after "$(show ActiveState)"
note flights "$(find /var/lib/landslope/flights -name frames.csv | wc -l)"
note owner "$(stat -c %U /var/lib/landslope/flights)"
echo 'nonsense' > /etc/landslope/landslope.toml
systemctl start landslope
for k in $(seq 600); do [ "$(show ActiveState)" = failed ] && break; sleep 0.1; done
note wrong_settings "$(show ExecMainStatus) $(show NRestarts)"
journalctl -u landslope --no-pager > journal.txt 2>&1
/opt/landslope/bin/landslope install --prefix /opt/landslope-python >> install.txt 2>&1; note install "$?"
note enabled "$(systemctl is-enabled landslope)"
/opt/landslope/bin/landslope install --uninstall --prefix /opt/landslope-python >> install.txt 2>&1; note uninstall "$?"
note unit_after "$(ls /etc/systemd/system/landslope.service 2>&1 | grep -c 'No such')"
journalctl -u landslope _TRANSPORT=stdout -o json --no-pager | head -1 > journal.json
"""


@pytest.mark.slow
@pytest.mark.skipif(not nspawn_support.possible(), reason="needs root, systemd-nspawn and overlay mounts")
def test_the_service_under_a_real_systemd(tmp_path):
    results = tmp_path / "results"
    results.mkdir()
    with nspawn_support.overlay(tmp_path) as root:
        if root is None:
            pytest.skip("overlay mounts are not allowed here")
        assert main(["install", "--root", str(root), "--no-enable"]) == 0
        (root / "etc/landslope/landslope.toml").write_text(SETTINGS)
        console = nspawn_support.boot(root, SCRIPT, results, timeout_s=300)
    if not (results / "results.toml").exists():
        pytest.skip(f"systemd did not boot in a container here: {console[-300:]}")
    journal = (results / "journal.txt").read_text()
    found = tomllib.loads((results / "results.toml").read_text())
    assert found["start"] == "0", journal
    assert found["active"] == found["alive"] == "active", journal
    assert found["user"] == "landslope"
    assert found["status"], journal
    assert found["restarts_before"] == "0", journal
    assert (found["restarts_after"], found["active_again"]) == ("1", "active"), journal
    # it ended by itself: one that does not is killed, and has failed
    assert (found["exit_status"], found["state_after"]) == ("0", "inactive"), journal
    assert found["owner"] == "landslope"
    assert int(found["flights"]) >= 1, journal
    assert found["wrong_settings"] == "2 0", journal
    said = (results / "install.txt").read_text()
    assert (found["install"], found["enabled"], found["uninstall"], found["unit_after"]) == (
        "0",
        "enabled",
        "0",
        "1",
    ), said
    assert "LANDSLOPE_UNIT" in (results / "journal.json").read_text()
