"""The coverage of a live calibration on a web page: the grid, the words, nothing else."""

import socket
import urllib.error
import urllib.request

import pytest

from companion.calibration.coverage_page import CoveragePage, address_of, page_of
from companion.errors import LandslopeError

DRAWN = "##..\n....\n2 views. Missing: 10 more <b>views</b>"


def fetched(port: int, path: str = "/") -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as answer:
        return answer.read().decode()


def test_the_page_has_the_grid_and_the_words():
    page = page_of(DRAWN)
    assert page.count('class="seen">') == 2
    assert page.count("<td") == 8
    assert "10 more &lt;b&gt;views&lt;/b&gt;" in page


def test_the_newest_state_is_served_and_nothing_else():
    with CoveragePage("127.0.0.1", 0) as served:
        assert "waiting for the camera" in fetched(served.port)
        served.show(DRAWN)
        assert "2 views" in fetched(served.port)
        with pytest.raises(urllib.error.HTTPError):
            fetched(served.port, "/etc/passwd")
        with pytest.raises(LandslopeError, match="cannot be served"), CoveragePage("127.0.0.1", served.port):
            pass
        with socket.create_connection(("127.0.0.1", served.port)):
            assert "2 views" in fetched(served.port), "one that says nothing keeps nobody waiting"


def test_addresses():
    assert address_of("8080") == ("127.0.0.1", 8080)
    assert address_of("0.0.0.0:80") == ("0.0.0.0", 80)
    for wrong in ("", "host", "host:", "1:99999", "8080x", "-1"):
        with pytest.raises(LandslopeError, match="write a port"):
            address_of(wrong)
