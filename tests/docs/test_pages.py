"""The pages: what they link is there, what they say of metrics and keys is whole, and the site needs no network."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import yaml

import credit

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
LINK = re.compile(r"(?<!`)\]\(([^)\s#]+)[^)]*\)")
MADE = {"configuration.md"}  # at build time
METRIC = re.compile(r"^\| `(\w+/[^`]+)`(?:, `(\w+/[^`]+)`)? \|", re.M)
NAME = re.compile(r"<\w+>")
ADVERTISER = ("method=disagreement", "trainer.steps=70")
SHORT = ("env=gymnasium", "method=reference", "feedback=block_sum", "feedback.window=20", "trainer.steps=400")
PENDULUM, CARTPOLE = ((*SHORT, f"env.id={name}-v1", "trainer.steps_per_round=200") for name in ("Pendulum", "CartPole"))
MAZE = ("experiment=pointmaze", "method=reference", "trainer.steps=3000", "agent.first_updates=4", "agent.updates=4")
RUNS = [
    ADVERTISER,
    ("experiment=sepsis", "method=reference", "trainer.steps=100"),
    *[(*PENDULUM, f"agent={name}") for name in ("sac", "td3")],
    *[(*CARTPOLE, f"agent={name}") for name in ("ppo", "discrete_sac")],
    MAZE,
]


@pytest.fixture
def configuration(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """What makes the page of all keys."""
    pytest.importorskip("mkdocs")
    monkeypatch.syspath_prepend(ROOT / "docs" / "hooks")
    found = ModuleType("configuration")
    found.__dict__.update(runpy.run_path(str(ROOT / "docs" / "hooks" / "configuration.py")))
    return found


def told() -> list[str]:
    """Names of metrics on their page, such as `weight/<model>`."""
    text = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
    return [name for pair in METRIC.findall(text) for name in pair if name]


def pattern(name: str) -> str:
    return r"\w+".join(map(re.escape, NAME.split(name)))


def written(words: tuple[str, ...], folder: Path) -> set[str]:
    """The columns of a run."""
    result = credit.run([*words, "replicas=1", "tracking=none", f"output={folder}"])
    assert result.error is None
    return {*credit.load(result.folders[0]).metrics.columns}


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize("page", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES], ids=lambda page: page.name)
def test_what_a_page_links_is_there(page: Path) -> None:
    links = [link for link in LINK.findall(page.read_text(encoding="utf-8")) if not link.startswith("http")]
    assert [link for link in links if link not in MADE and not (page.parent / link).exists()] == []


def test_every_page_can_be_found() -> None:
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if f": {page.name}" not in nav] == []


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == credit.__version__
    assert {"cff-version", "message", "title", "authors", "license"} <= {*cited}


@pytest.mark.parametrize(
    ("text", "names", "said"),
    [
        ("One.\n\nArgs:\n    a: first. b: second; not c: this.", "ab", {"a": "first.", "b": "second; not c: this."}),
        (
            "One.\n\nArgs:\n    a, b: both,\n        and more.\n\nRaises:\n    E: b: no.",
            "ab",
            dict.fromkeys("ab", "both, and more."),
        ),
        ("One, without any: a: b.", "ab", {}),
        ("One.\n\nArgs:\n    a: first.\n    b: second.", "a", {"a": "first. b: second."}),
    ],
)
def test_arguments_of_a_docstring(configuration: ModuleType, text: str, names: str, said: dict[str, str]) -> None:
    assert configuration.arguments(text, names) == said


def test_comments_beside_keys(configuration: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("# What.\n_target_: a.B\nscale: 0.3   # c\nparts:\n  one: [1, 2]  # first\n  two: 2\nleft: null\n")
    assert configuration.commented(file) == [
        ("scale", "0.3", "c"),
        ("parts.one", "[1, 2]", "first"),
        ("parts.two", "2", ""),
        ("left", "null", ""),
    ]


def test_keys_of_a_group_say_what_they_are(configuration: ModuleType) -> None:
    (path,) = [path for name, path in configuration.ours("mixer").items() if name == "relative_mse"]
    text = "\n".join(configuration.options("mixer", path))
    assert "| `alpha` | `0.5`" in text
    assert r"float \> 0" in text


@pytest.mark.thorough
def test_every_key_of_every_group_says_what_it_is(configuration: ModuleType) -> None:
    text = "\n".join(configuration.page())
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) > 300
    assert [row for row in rows if row.removesuffix(" |").endswith("|")] == []
    for kind in credit.list().index:
        for name in configuration.ours(kind):
            assert f"`{kind}={name}`" in text or f"| `{name}` |" in text


def test_metrics_of_a_run_are_on_their_page(tmp_path: Path) -> None:
    known = [pattern(name) for name in told()]
    assert [name for name in written(ADVERTISER, tmp_path) if not any(re.fullmatch(one, name) for one in known)] == []


@pytest.mark.slow
def test_the_page_of_metrics_is_whole_and_true(tmp_path: Path) -> None:
    found = set().union(*(written(words, tmp_path) for words in RUNS))
    known = [pattern(name) for name in told()]
    assert [name for name in sorted(found) if not any(re.fullmatch(one, name) for one in known)] == []
    assert [one for one in known if not any(re.fullmatch(one, name) for name in found)] == []


@pytest.mark.thorough
def test_the_site_builds_and_fetches_nothing(tmp_path: Path) -> None:
    pytest.importorskip("material")
    pytest.importorskip("mkdocstrings")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.glob("*.html")}
    assert {"index.html", "start.html", "configuration.html", "api.html"} <= {*pages}
    fetched = re.compile(r"<(?:script|img|iframe)[^>]+src=\"(?:https?:)?//|<link[^>]+href=\"(?:https?:)?//")
    assert [name for name, text in pages.items() if fetched.search(text)] == []
    assert "kiosk" in (tmp_path / "files/examples/own_environment.py.txt").read_text(encoding="utf-8")
