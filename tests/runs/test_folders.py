"""One folder, one configuration: whoever asks for whichever seeds, and however it was typed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import credit
from credit.config import classes
from credit.config.identity import namesakes
from credit.core.errors import UserError
from credit.core.naming import registered_name
from credit.recovery.bonuses import Count
from credit.runs.composing import compose
from credit.runs.journal import read_json
from credit.runs.resume import interrupted

SHORT = ["method=adaptive_mse", "trainer.steps=70", "tracking=none"]


@pytest.fixture
def own(tmp_path: Path) -> Path:
    (tmp_path / "conf" / "mixer").mkdir(parents=True)
    return tmp_path / "conf"


def mixer(own: Path, alpha: float) -> None:
    (own / "mixer" / "mine.yaml").write_text(f"_target_: credit.recovery.mixers.RelativeMSE\nalpha: {alpha}\n")


def test_other_seeds_of_another_configuration_are_refused(own: Path, tmp_path: Path) -> None:
    words = [*SHORT, "mixer=mine", f"output={tmp_path / 'out'}"]
    mixer(own, 0.1)
    credit.run([*words, "replicas=2"], config_dirs=[str(own)])
    mixer(own, 0.9)
    for others in (["seed=2", "replicas=1"], ["seed=0", "replicas=1", "rerun=true"]):
        with pytest.raises(UserError, match=r"holds a run of another configuration: mixer\.alpha: 0\.1 → 0\.9"):
            credit.run([*words, *others], config_dirs=[str(own)])
    done = credit.run([*words, "replicas=2", "rerun=true"], config_dirs=[str(own)])
    assert done.computed == [0, 1]


def test_names_that_look_the_same_are_two_folders() -> None:
    one, other = (compose([*SHORT, f"reference.name={name}"])["slug"] for name in ("'a b'", "a-b"))
    assert other == "reference.name=a-b,trainer.steps=70"
    assert one.startswith("reference.name=a-b,trainer.steps=70-")


def test_two_classes_of_one_name_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse, fine = (type("Season", (Count,), {"__module__": f"shop.{name}"}) for name in ("coarse", "fine"))
    known = {"shop.coarse.Season": coarse, "shop.fine.Season": fine, "shop.moved.Season": fine}

    def resolve(path: str, node: dict[str, str]) -> type:
        if node["_target_"] not in known:
            raise UserError("it is gone")
        return known[node["_target_"]]

    monkeypatch.setattr(classes, "resolve", resolve)
    nodes = {name: {"bonus": {"count": {"_target_": name}}} for name in (*known, "shop.gone.Season")}
    assert registered_name("shop.coarse", "Season") == registered_name("shop.fine", "Season") == "shop:season"
    two = ("shop.coarse.Season", "shop.fine.Season")
    assert list(namesakes(nodes[two[0]], nodes[two[1]])) == [two]
    assert not list(namesakes(nodes[two[1]], nodes["shop.moved.Season"]))
    assert not list(namesakes(nodes["shop.gone.Season"], nodes[two[1]]))  # it moved


def test_folders_that_are_no_runs_are_left_alone(tmp_path: Path) -> None:
    run = tmp_path / "out" / "advertiser" / "reference" / "default" / "seed-0.bak"
    run.mkdir(parents=True)
    (run / "config.yaml").write_text("{}")
    with pytest.raises(UserError, match="no run lies here"):
        interrupted(tmp_path)


@pytest.mark.parametrize("text", ["", "[1]", '{"a": '])
def test_a_damaged_record_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(text)
    with pytest.raises(UserError, match=r"summary\.json: damaged; restore it"):
        read_json(tmp_path / "summary.json")
    (tmp_path / "summary.json").write_text(json.dumps({"a": 1}))
    assert read_json(tmp_path / "summary.json") == {"a": 1}
