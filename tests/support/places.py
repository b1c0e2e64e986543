"""Where the tests find the repository's own files."""

from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
SITL_LOGS = REPOSITORY / "sitl_logs"
DOCS = REPOSITORY / "docs"
SUPPORT = Path(__file__).parent
TOOLS = REPOSITORY / "tests" / "tools"
