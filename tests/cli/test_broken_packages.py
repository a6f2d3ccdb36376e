"""Packages that announced themselves and are broken, or have names that are taken: told, and fatal only when used."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from credit.cli import list as listing
from credit.config import classes, files, registry
from credit.core.errors import UserError
from credit.runs import job

RIDGE = "# Mine.\n_target_: credit.recovery.models.linear.LinearModel\nname: mine\n"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A broken package, one with a name that is taken, and an entry point of one that is gone."""
    for name, text, option, yaml in (
        ("broken_plugin", "raise RuntimeError('no licence')", "thing", "# Broken.\n_target_: broken_plugin.Thing\n"),
        ("taken_plugin", "", "ridge", RIDGE),
        ("gone_plugin", None, "", ""),
    ):
        if text is not None:
            (tmp_path / name / "conf" / "reward").mkdir(parents=True)
            (tmp_path / name / "__init__.py").write_text(text)
            (tmp_path / name / "conf" / "reward" / f"{option}.yaml").write_text(yaml)
        facts = tmp_path / f"{name}-1.0.dist-info"
        facts.mkdir()
        (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        module = f"{name}.sub" if text is None else name
        (facts / "entry_points.txt").write_text(f"[credit.components]\n{name} = {module}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    caches = (files.package_dirs, classes.allowed_packages)
    for cache in caches:
        cache.cache_clear()
    yield tmp_path
    monkeypatch.undo()
    for cache in caches:
        cache.cache_clear()
    sys.modules.pop("broken_plugin", None)


def test_a_list_skips_and_names_them(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert listing.main(["reward"]) == 0
    said = capsys.readouterr()
    assert "reward=thing is skipped" in said.err
    assert "broken_plugin raised RuntimeError: no licence" in said.err
    assert "gone_plugin.sub" in said.err
    assert f"reward=ridge means several parts: {files.conf_dir() / 'reward' / 'ridge.yaml'}, " in said.err
    assert "the tabular reference" in said.out  # credit's own ridge


def test_a_name_that_means_several_parts_is_refused_where_it_is_typed(site: Path) -> None:
    own = site / "taken_plugin" / "conf" / "reward" / "ridge.yaml"
    with pytest.raises(UserError, match="reward=ridge means several parts") as refused:
        registry.compose(["experiment=advertiser", "reward=ridge"])
    assert str(own) in str(refused.value)
    mine = site / "mine" / "reward"
    mine.mkdir(parents=True)
    (mine / "ridge.yaml").write_text((files.conf_dir() / "reward" / "ridge.yaml").read_text())
    assert registry.compose(["experiment=advertiser", "reward@reference=ridge"], [str(mine.parent)])["reference"]


def test_they_are_fatal_when_used_and_only_then(site: Path) -> None:
    assert not job.check(registry.compose(["experiment=advertiser", "tracking=none"])).problems
    with pytest.raises(UserError, match="broken_plugin raised RuntimeError: no licence"):
        classes.resolve("reward", {"_target_": "broken_plugin.Thing"})
