"""Secrets inside of texts: what stands in a URL for one reader must not stand in a log for all."""

import re

MASK = "***"

_USERINFO = re.compile(r"(?i)\b([a-z][a-z0-9+.-]*://)[^\s\"'<>]*@")
"""Name and password in front of a host. Up to the last @: a password may hold one that nobody encoded."""

_PARAMETER = re.compile(
    r"(?i)([?&;][^=&;\s\"']*(?:pass|pwd|token|secret|key|auth)[^=&;\s\"']*=)[^&;\s\"'<>]+"
)
"""Values in a URL's query whose name says that they are secret."""


KEY_DIGITS = 64
_KEY = re.compile(rf"[0-9A-Fa-f]{{{KEY_DIGITS},}}")
"""A key of 32 bytes in hexadecimal digits, one with too many of them too."""


def is_key(text: str) -> bool:
    """Whether a text is a key of 32 bytes by itself."""
    return len(text) == KEY_DIGITS and _KEY.fullmatch(text) is not None


def masked(text: str) -> str:
    """The text with keys, and the secrets of its URLs, replaced by ``***``."""
    text = _KEY.sub(MASK, text)
    if "://" not in text:
        return text
    return _PARAMETER.sub(rf"\g<1>{MASK}", _USERINFO.sub(rf"\g<1>{MASK}@", text))
