"""Sweeps that stand in files: what they expand to, against the words of the pages typed out."""

from __future__ import annotations

import itertools
import shlex

import pytest

from credit.config import files, registry, sweeps
from credit.core.errors import UserError
from credit.runs import job
from credit.runs.composing import compose

FILES = [
    pytest.param(name, marks=() if name == "table1" else pytest.mark.slow) for name in sorted(files.options("sweep"))
]
METHODS = "block,delayed,reference,adaptive_mse,disagreement,block_fair,delayed_fair,thompson,elliptical,oracle,random"


@pytest.mark.thorough
@pytest.mark.parametrize("name", FILES)
def test_every_file_composes_and_checks(name):
    jobs = sweeps.expand([f"sweep={name}", "tracking=none"])
    plans = [job.plan(compose(words)) for words in jobs]
    folders = {(plan["experiment"], plan["method"], plan["slug"]) for plan in plans}
    assert len(folders) == len(jobs) > 1, "two jobs in one folder"


def grid(words: str) -> list[dict[str, str]]:
    """The jobs of a command of the pages, by a second, naive reading of its words."""
    pairs = [word.partition("=")[::2] for word in shlex.split(words)]
    values = [[value] if value.startswith("[") else value.split(",") for _, value in pairs]
    return [dict(zip([key for key, _ in pairs], choice, strict=True)) for choice in itertools.product(*values)]


FEW = "experiment=pointmaze seed=2000 replicas=10 method=reference,disagreement,delayed_fair"


@pytest.mark.parametrize(
    ("name", "commands"),
    [
        (
            "table1",
            [
                f"experiment=advertiser seed=1000 replicas=100 method={METHODS}",
                "experiment=advertiser seed=1000 replicas=100 "
                "method=disagreement transition=shift_mixture bonus.count.scale=0.2",
            ],
        ),
        ("pointmaze_few", [f"{FEW} env.successes={n} env.partials={n} env.failures={n}" for n in (3, 1)]),
        ("pointmaze_large", [f"{FEW} env.maze=Large env.goal=[7,10] feedback.window=440 trainer.steps=26400"]),
    ],
)
def test_a_file_stands_for_the_commands_of_the_readme(name, commands):
    expected = [choice for command in commands for choice in grid(command)]
    found = [dict(word.split("=", 1) for word in words) for words in sweeps.expand([f"sweep={name}"])]
    assert len(found) == len(expected)
    assert {frozenset(words.items()) for words in found} == {frozenset(words.items()) for words in expected}


def test_a_row_that_leaves_something_out_has_the_folder_of_the_command():
    words = next(words for words in sweeps.expand(["sweep=sepsis"]) if any("~" in word for word in words))
    assert compose(words)["slug"] == "~surrogates.health,~surrogates.health_last"


def test_typed_words_count_more_than_those_of_the_file():
    jobs = sweeps.expand(["sweep=table1", "seed=0,5", "replicas=20"])
    assert len(jobs) == 2 * 12
    assert {word for words in jobs for word in words if word.startswith(("seed", "replicas"))} == {
        "seed=0",
        "seed=5",
        "replicas=20",
    }


@pytest.mark.thorough
def test_a_file_of_ones_own(credit, folder):
    file = folder / "mine/sweep/small.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(
        "# @package _global_\n# Small.\nhydra:\n  sweeper:\n    params: {method: 'block,random', replicas: 1}\n"
        "sweep:\n  rows: [method=random env.p_up=.5]\n"
    )
    short = ("--config-dir", "mine", "trainer.steps=350", "tracking=none", "hydra/launcher=basic")
    assert "Small." in credit("list", "sweep", "--config-dir", "mine").out
    assert "# 3 jobs, all right" in credit("check", "-m", "sweep=small", *short).out
    for words in (("-m", "sweep=small"), ("sweep=small",)):  # a sweep from a file needs no -m
        ended = credit("train", *words, *short)
        assert ended.code == 0, ended.err
    assert "jobs     3 done before" in ended.out
    assert len(list(folder.rglob("DONE"))) == 3
    assert (folder / "outputs/advertiser/random/env.p_up=0.5,trainer.steps=350/seed-0/DONE").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sweep=tabel1"], "did you mean 'table1'"),
        (["sweep=table1,sepsis"], "one sweep at a time"),
        (["sweep=table1", "sweep=sepsis"], "one sweep at a time"),
    ],
)
def test_bad_sweeps(words, message):
    with pytest.raises(UserError, match=message):
        sweeps.expand(words)


def test_what_is_wrong_with_some_jobs_alone_names_them(credit):
    ended = credit("check", "-m", "method=glob(delayed*)", "trainer.steps=70")
    assert ended.code == 2
    assert "episodic, and this one is continuing" in ended.err
    assert ended.err.rstrip().endswith("(with method=delayed_monte_carlo)")
    ended = credit("check", "-m", "method=reference,delayed", "foo=1", "seed=0,1")
    assert ended.err.count("foo") == 2  # of all jobs, once
    assert "(with" not in ended.err


def test_one_job_is_no_sweep():
    with pytest.raises(UserError, match="credit train -m sweep=table1"):
        registry.compose(["sweep=table1"])


def test_what_becomes_of_the_others_is_no_part_of_a_run():
    words = ["method=random", "tracking=none"]
    plans = [job.plan(compose(more)) for more in (words, [*words, "sweep.on_error=stop"])]
    assert plans[0] == plans[1]
    assert job.check(registry.compose([*words, "sweep.on_error=halt"])).problems == [
        "sweep={'on_error': 'halt'}: Input should be 'continue' or 'stop'; "
        "allowed: a mapping: one of on_error → one of continue, stop"
    ]
