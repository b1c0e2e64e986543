"""The tools that README and docs name start as they are written there: they find all that they import."""

import os
import re
import subprocess
import sys

import pytest
from documented import PAGES
from places import REPOSITORY

WRITTEN = re.compile(r"(?:PYTHONPATH=(\S+) )?python (tests/\S+\.py)")
TOOLS = sorted({found for page in PAGES for found in WRITTEN.findall(page.read_text())})


def test_some_are_documented() -> None:
    assert len(TOOLS) > 3


@pytest.mark.parametrize(("path", "tool"), TOOLS, ids=[tool for _, tool in TOOLS])
def test_a_documented_tool_starts(path: str, tool: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    # where the package is not installed the repository stands for it
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (path, str(REPOSITORY))))
    code = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='started')"
    command = [sys.executable, "-c", code, tool]
    ended = subprocess.run(command, cwd=REPOSITORY, env=environment, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
