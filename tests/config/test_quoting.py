"""A text that was quoted is what it was, whatever is in it."""

from __future__ import annotations

import pytest

from credit.config import registry
from credit.config.quoting import quoted

TEXTS = [
    "c,d",
    "br[1]",
    "eq=1",
    "it's",
    "d${x}",
    "a\\${b}",
    "end\\",
    "q'\\'",
    "{a: 1}",
    "h#x ü",
    "null",
    "3",
    " a ",
    "",
]


@pytest.mark.parametrize("text", TEXTS)
def test_what_was_quoted_is_read_as_it_was(text: str) -> None:
    assert registry.compose([f"title={quoted(text)}"])["title"] == text
