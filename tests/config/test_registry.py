"""Hydra's side: compose, explain what cannot be composed, expand sweeps, name folders."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from credit.config import files, kinds, registry
from credit.core.errors import UserError
from credit.runs import job


@pytest.fixture
def own_folder(tmp_path: Path) -> Path:
    """A user's folder with a bonus of its own."""
    (tmp_path / "bonus").mkdir()
    text = "# @package bonus.mine\n# My own bonus.\n_target_: credit.recovery.bonuses.Count\nscale: 0.7  # c\n"
    (tmp_path / "bonus" / "mine.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_composed_configurations_are_plain() -> None:
    config = registry.compose(["method=reference"])
    assert type(config) is dict
    assert type(config["env"]) is dict
    assert type(config["env"]["interaction"]) is list
    assert config["method"] == "reference"
    assert config["title"] == "Ridge-UCB"
    assert not {"hydra", "planner", "learner"} & config.keys()


def test_methods_choose_their_parts() -> None:
    config = registry.compose(["method=disagreement"])
    assert list(config["bonus"]) == ["count", "disagreement"]
    assert list(config["surrogates"]) == ["linear", "threshold"]
    assert config["surrogates"]["threshold"]["features"]["threshold"] == 4
    assert registry.compose(["method=delayed"])["agent"]["_target_"].endswith("QLearning")


def test_overrides_win_over_the_method() -> None:
    config = registry.compose(["method=disagreement", "mixer=best", "bonus=[none]", "env.states=6"])
    assert config["mixer"]["_target_"].endswith("Best")
    assert not config.get("bonus")
    assert config["env"]["states"] == 6


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("method=disagrement", ["method=disagrement", "no such option", "did you mean 'disagreement'", "oracle"]),
        ("experiment=advertizer", ["experiment=advertizer", "did you mean 'advertiser'"]),
        ("mixer=relative", ["mixer=relative", "no such option", "best", "relative_mse"]),
        ("bonus=[count,disagremnt]", ["bonus=disagremnt", "did you mean 'disagreement'"]),
        ("reward@reference=rige", ["reward=rige", "did you mean 'ridge'"]),
        ("mixer.alfa=1", ["mixer.alfa", "unknown key", "did you mean 'alpha'", "RelativeMSE"]),
        ("replica=3", ["replica", "unknown key", "did you mean 'replicas'"]),
        ("feedbck.window=3", ["feedbck", "unknown key", "did you mean 'feedback'"]),
        ("feedback.windw=3", ["feedback.windw", "did you mean 'window'"]),
        (
            "feedback.mising=.5",
            ["feedback.mising", "did you mean 'missing'? (valid: cut, delay, delay_windows,", "noise"],
        ),
        ("reference.likelyhood=logistic", ["unknown key of LinearModel", "did you mean 'likelihood'"]),
        ("surrogates.linear.units=3", ["surrogates.linear.units", "did you mean 'unit'"]),
        ("surrogates.linear.features.foo=3", ["surrogates.linear.features.foo", "unknown key"]),
        ("methd=delayed", ["methd", "unknown key", "did you mean 'method'"]),
        ("seed", ["'seed'", "is no override", "key=value"]),
        ("seed=[1", ["seed=[1", "is no override"]),
        ("policy_from=o/a=1/seed-0", ["stands in quotes", "'policy_from=\"o/a=1/seed-0\"'"]),
    ],
)
def test_what_cannot_be_composed_is_explained(override: str, said: list[str]) -> None:
    with pytest.raises(UserError) as error:
        registry.compose([override])
    for part in said:
        assert part in str(error.value), str(error.value)


@pytest.mark.parametrize("override", ["mixer=null", "bonus=null", "method=null", "mixer=3", "=3"])
def test_what_is_no_name_of_an_option_is_explained(override: str) -> None:
    with pytest.raises(UserError, match=override):
        registry.compose([override])


@pytest.mark.parametrize("other", ["replicas=3", "method=delayed"])
def test_the_wrong_one_of_several_overrides_is_named(other: str) -> None:
    with pytest.raises(UserError, match=r"env\.stats.*did you mean 'states'"):
        registry.compose([other, "env.stats=3", "seed=4"])


def test_composing_leaves_nothing_behind() -> None:
    first = registry.compose(["method=disagreement"])
    registry.compose(["method=delayed", "seed=9"])
    with pytest.raises(UserError):
        registry.compose(["method=none_such"])
    assert registry.compose(["method=disagreement"]) == first


def test_a_users_own_folder(own_folder: Path) -> None:
    folders = [str(own_folder)]
    config = registry.compose(["bonus=[mine,count]"], folders)
    assert config["bonus"]["mine"] == {"_target_": "credit.recovery.bonuses.Count", "scale": 0.7}
    assert files.options("bonus", folders)["mine"] == own_folder / "bonus" / "mine.yaml"
    assert "mine" not in files.options("bonus")
    assert files.describe_file(own_folder / "bonus" / "mine.yaml") == "My own bonus."
    with pytest.raises(UserError, match=r"did you mean 'mine'"):
        registry.compose(["bonus=[mien]"], folders)
    with pytest.raises(UserError, match=r"bonus=mine: no such option"):
        registry.compose(["bonus=[mine]"])


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"absent: no such folder"):
        registry.compose([], [str(tmp_path / "absent")])


def test_is_sweep() -> None:
    assert registry.is_sweep("method=a,b")
    assert registry.is_sweep("seed=range(0,3)")
    assert not registry.is_sweep("method=a")
    assert not registry.is_sweep("bonus=[count,disagreement]")


def test_every_kind_has_a_folder_a_class_and_options() -> None:
    for name, kind in kinds.KINDS.items():
        assert files.options(name), name
        assert isinstance(kind.load(), type), name
        assert kind.help
    folders = {path.name for path in files.conf_dir().iterdir() if path.is_dir()}
    assert folders == {*kinds.KINDS, *kinds.CHOICES, "hydra"}


@pytest.mark.parametrize("name", sorted({*kinds.KINDS, *kinds.CHOICES}))
def test_every_file_says_in_its_first_line_what_it_is(name: str) -> None:
    for path in files.options(name).values():
        assert files.describe_file(path), path


@pytest.mark.parametrize(
    "words",
    [
        ("method=disagreement", "trainer.steps=70", "env.gain=0.06"),
        ("experiment=sepsis", "trainer.steps=200", "method=delayed", "trainer.windows_per_round=10", "seed=3"),
        ("experiment=pointmaze", "env.successes=3"),
    ],
)
def test_composed_fixture_composes(composed: Callable[..., dict[str, object]], words: tuple[str, ...]) -> None:
    assert composed(*words) == job.checked(registry.compose(["tracking=none", *words]))


def test_composed_fixture_is_checked(composed: Callable[..., dict[str, object]]) -> None:
    config = composed("method=delayed")
    assert "mixer" not in config  # not used by it
    assert "agent" in config


def test_episodes_that_are_typed_take_the_place_of_a_files_steps() -> None:
    budgets = {
        ("trainer.episodes=9",): (None, 9.0),
        ("trainer.episodes=9", "trainer.steps=50"): (50, 9),  # which the check refuses
        ("trainer.episodes=null",): (15000, None),
    }
    for words, budget in budgets.items():
        found = registry.compose(["experiment=sepsis", *words])["trainer"]
        assert (found["steps"], found["episodes"]) == budget
