"""Folder names: what differs from the method on this experiment, in one spelling, whatever was typed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from credit.config import registry, slugs
from credit.runs import job
from credit.runs.composing import compose


def slug(*words: str, dirs: tuple[str, ...] = ()) -> str:
    config: dict[str, Any] = job.checked(registry.compose(["tracking=none", *words], dirs))
    return slugs.slug(config, words, dirs)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("", "default"),
        ("experiment=advertiser method=reference seed=3 replicas=7 output=x device=cpu", "default"),
        ("rerun=true title=Mine", "default"),
        ("mixer.alpha=.3", "mixer.alpha=0.3"),
        ("mixer.alpha=.3 env.states=6 seed=1", "env.states=6,mixer.alpha=0.3"),
        ("mixer.alpha=1", "mixer.alpha=1.0"),
        ("env.interaction=[0,.05]", "env.interaction=0,0.05"),
        ("bonus=[count, local_mse]", "bonus=count,local_mse"),
        ("bonus=[none]", "bonus=none"),
        ("uncertainty=analytic", "uncertainty=analytic"),
        ("experiment=sepsis feedback=terminal", "feedback=terminal"),
        ("experiment=sepsis feedback=terminal feedback.window=6", "feedback.window=6,feedback=terminal"),
        ("+reward@surrogates.m=linear surrogates.m.name=m", "reward@surrogates.m=linear,surrogates.m.name=m"),
        ("~surrogates.linear", "~surrogates.linear"),
        ("experiment=pointmaze method=disagreement bonus.disagreement.scale=.2", "bonus.disagreement.scale=0.2"),
    ],
)  # fmt: skip
def test_slugs(words: str, expected: str) -> None:
    assert slug(*words.replace(", ", ",").split()) == expected


def test_keys_of_two_kinds_are_a_name_of_their_own() -> None:
    words = ("method=disagreement", "+reward@surrogates.c=cells")
    found = slug(*words, "surrogates.c.features.cells={0:5,a:3}")
    assert found.startswith("reward@surrogates.c=cells,surrogates.c.features.cells=-0-5,a-3-")


@pytest.mark.parametrize(
    "words",
    [
        "mixer.alpha=.5",
        "experiment=sepsis mixer.alpha=1",  # by the experiment's default
        "method=delayed mixer=best mixer=uniform",  # that the run does not use
        *(
            pytest.param(words, marks=pytest.mark.thorough)
            for words in (
                "mixer.alpha=0.50",
                "++mixer.alpha=.5",
                "mixer=relative_mse",
                "agent=value_iteration bonus=[count,disagreement]",
                "feedback=block_sum feedback.window=7",
                "env=advertiser env.states=10",
                "experiment=sepsis feedback.window=5",
                "method=delayed agent=q_learning",
                "env=sepsis",
            )
        ),
    ],
)
def test_what_changes_nothing_is_no_part_of_a_slug(words: str) -> None:
    assert slug(*words.split()) == "default"


def test_the_order_of_words_decides_nothing() -> None:
    words = ["env.gain=.06", "bonus=[count]", "transition=shift_mixture", "env.states=6"]
    assert slug(*words) == slug(*reversed(words))


def test_long_slugs_of_different_words_differ_and_stay_short() -> None:
    keys = ("gain", "crowding", "cost", "convexity", "p_down", "p_up", "p_mid_down", "p_mid_up")
    many = [f"env.{key}=0.0123456789" for key in keys]
    found = {slug(*many, "env.states=9"), slug(*many, "env.states=8")}
    assert len(found) == 2
    assert all(len(name) <= slugs.LONGEST for name in found)


def test_a_slug_is_one_folder() -> None:
    assert "/" not in slug("env.interaction=[0,.05]", "title=a/b/../c")


def test_what_only_a_users_own_file_says_is_a_word_of_its_own(tmp_path: Path) -> None:
    own = tmp_path / "mixer" / "mine.yaml"
    own.parent.mkdir()
    own.write_text("# Mine.\n_target_: credit.recovery.mixers.RelativeMSE\nalpha: 0.3\nepsilon: 1.0e-12\n")
    assert slug("mixer=mine", dirs=(str(tmp_path),)) == "mixer=mine"
    own.rename(own.with_name("relative_mse.yaml"))  # in place of ours: as if it had been typed
    assert slug(dirs=(str(tmp_path),)) == "mixer.alpha=0.3"


def test_runs_that_lie_under_another_name_are_found(tmp_path: Path) -> None:
    """By other words for the same, or by an older rule."""
    short = ["method=random", "replicas=1", "trainer.steps=70", "tracking=none", f"output={tmp_path}"]
    first = compose(short)
    assert first["slug"] == "trainer.steps=70"
    folder = tmp_path / "advertiser/random" / first["slug"]
    import credit

    credit.run(short)
    folder.rename(folder.with_name("tuned.noise=0.2,trainer.steps=70"))
    assert compose(short)["slug"] == "tuned.noise=0.2,trainer.steps=70"
    assert credit.run([*short, "replicas=2"]).skipped == [0]
    assert not folder.exists()
    assert compose([*short, "env.gain=.06"])["slug"] == "env.gain=0.06,trainer.steps=70"


def test_a_damaged_neighbour_is_no_hindrance(tmp_path: Path) -> None:
    file = tmp_path / "advertiser/random/other/seed-0/config.yaml"
    file.parent.mkdir(parents=True)
    for text in ("{", "env: 3", "env: {_target_: gone.For.Good}"):
        file.write_text(text)
        assert compose(["method=random", "tracking=none", f"output={tmp_path}"])["slug"] == "default"
