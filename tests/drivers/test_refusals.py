"""The table of refusals is complete: every code has a meaning, is used, and is documented."""

from places import REPOSITORY

from drivers.refusals import REFUSAL_MEANING, RefusalCode


def test_every_code_has_a_meaning_of_its_own() -> None:
    assert set(REFUSAL_MEANING) == set(RefusalCode)
    assert len(set(REFUSAL_MEANING.values())) == len(RefusalCode)


def test_every_code_is_used_and_documented() -> None:
    table = REPOSITORY / "drivers/refusals.py"
    sources = [
        p for room in ("drivers", "companion") for p in (REPOSITORY / room).rglob("*.py") if p != table
    ]
    text = "".join(path.read_text() for path in sources)
    assert [code.name for code in RefusalCode if f"RefusalCode.{code.name}" not in text] == []
    page = (REPOSITORY / "docs/messages.md").read_text()
    assert [code for code in RefusalCode if f"| `{code}` | {REFUSAL_MEANING[code]} |" not in page] == []
