"""What messages never say."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ADVICE = re.compile(
    r"\b(delete|remove|erase|discard)\s+(it|them|this|that|the|an?|your|its|old|outdated)\b|\brm -r", re.IGNORECASE
)


def shown(path: Path) -> list[str]:
    """The texts of a module that are not docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [str(node.value) for node in texts if id(node) not in told]


@pytest.mark.parametrize("room", ["credit", "launch"])
def test_no_message_advises_to_delete_what_was_computed(room: str):
    found = {f"{path}: {text}" for path in (ROOT / room).rglob("*.py") for text in shown(path) if ADVICE.search(text)}
    assert not found


def test_the_search_finds_such_advice(tmp_path: Path):
    path = tmp_path / "a.py"
    path.write_text('"""Delete the folder."""\nx = f"{1} is damaged. Delete the folder and run this seed again."\n')
    assert [bool(ADVICE.search(text)) for text in shown(path)] == [True]
