"""What makes a setting: all of the problem and the budget, nothing of the learner."""

import inspect
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from credit.config import kinds, registry, slugs
from credit.core.errors import UserError
from credit.report.published import load_paper
from credit.report.runs import load_runs
from credit.report.settings import (
    BUDGET,
    PROBLEM,
    SCHEDULE,
    choose_settings,
    describe,
    has,
    is_called,
    name_settings,
    read_setting,
    values_of,
)
from credit.report.variants import variant
from credit.trainer import Trainer

from .conftest import BLOCK_SUM, ENV, TERMINAL, TRAINER, WriteRun

REGRET = {"regret/cumulative": 1.0}


def text(feedback: dict[str, Any] = BLOCK_SUM, env: dict[str, Any] = ENV, trainer: dict[str, Any] = TRAINER) -> str:
    return json.dumps(values_of({"feedback": feedback, "env": env, "trainer": trainer}), sort_keys=True)


def names(*texts: str) -> list[str]:
    found = name_settings(texts)
    return [found[each].name for each in texts]


@pytest.mark.parametrize(
    ("slug", "left"),
    [
        ("default", "default"),
        ("feedback=terminal", "default"),
        ("feedback.noise=0.5,feedback=block_sum", "default"),
        ("bonus.count.scale=0.1,feedback=terminal,transition=mixture", "bonus.count.scale=0.1,transition=mixture"),
        ("env.interaction=0.0,0.02,0.05,mixer.alpha=1.0,tuned.noise=0.5,tuned.window=3", "mixer.alpha=1.0"),
        ("env.goal=7,10,env.maze=Large,trainer.steps=26400,tuned.window=440", "default"),
        ("env.successes=3,env=pointmaze,scaler=plain", "scaler=plain"),
        ("trainer.log_every=1,trainer.steps=70", "trainer.log_every=1"),
        ("demonstrations_from=log.csv,policy_from=o-seed-0", "policy_from=o-seed-0"),
        ("tuned.mixer_alpha=1.0", "tuned.mixer_alpha=1.0"),
        ("+feedback.extra=1,feedback=terminal,~bonus.count", "~bonus.count"),
        ("environment.env.feedback=1,feedbacks=2", "environment.env.feedback=1,feedbacks=2"),
    ],
)
def test_a_variant_leaves_out_what_makes_the_setting(slug: str, left: str):
    assert variant(slug) == left


def test_every_slot_and_every_key_of_the_trainer_is_of_the_problem_or_of_the_learner():
    """What is new must be put on one side, or runs of other problems become variants of a method."""
    slots = {slot for kind in kinds.KINDS.values() for slot in kind.slots}
    learner = {
        "reference",
        "surrogates",
        "uncertainty",
        "mixer",
        "bonus",
        "assigner",
        "transition",
        "agent",
        "scaler",
        "encoder",
    }
    assert slots == {*PROBLEM, *learner, "tracking"}
    keys = {name for name in inspect.signature(Trainer).parameters if name not in slots}
    assert keys == {*SCHEDULE, *BUDGET}


def test_a_setting_is_read_from_what_a_run_writes(tmp_path: Path):
    config = registry.compose(
        ["experiment=advertiser", "method=disagreement", "mixer.alpha=.3", "seed=7", "replicas=2"]
    )
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    found = json.loads(read_setting(tmp_path))
    assert found == json.loads(text())
    others = registry.compose(["experiment=advertiser", "method=delayed", "trainer.windows_per_round=3"])
    assert values_of(others) == found
    paper = load_paper("advertiser")
    assert paper is not None
    assert has(json.dumps(found), paper.setting)
    assert not has(text(trainer={**TRAINER, "steps": 700}), paper.setting)


@pytest.mark.parametrize(
    "override",
    [
        *("feedback=terminal", "feedback.noise=.5", "feedback.window=3", "env.states=12", "env.p_up=.5"),
        "trainer.steps=700",
    ],
)
def test_what_changes_the_problem_or_the_budget_changes_the_setting(override: str):
    assert values_of(registry.compose([override])) != values_of(registry.compose([]))
    assert variant(slugs.slug(registry.compose([override]), [override])) == "default"


@pytest.mark.parametrize(
    "override",
    [
        *("mixer.alpha=.1", "bonus=[count]", "transition=exact", "uncertainty.draws=3", "reward@reference=linear"),
        *(
            "trainer.windows_per_round=2",
            "trainer.log_every=10",
            "device=cpu",
            "checkpoint_seconds=1",
            "tracking=none",
            "method=block",
        ),
    ],
)
def test_what_changes_the_learner_does_not(override: str):
    assert values_of(registry.compose([override])) == values_of(registry.compose([]))


def test_settings_have_the_shortest_name_that_tells_them_apart():
    assert names(text(), text(TERMINAL)) == ["block_sum", "terminal"]
    assert list(name_settings([text(TERMINAL), text()])) == [text(), text(TERMINAL)]
    quiet, other = text({**BLOCK_SUM, "noise": 0.0}), text({**BLOCK_SUM, "window": 3})
    assert names(text(), quiet, text(TERMINAL)) == ["block_sum-noise=0.2", "block_sum-noise=0.0", "terminal"]
    assert names(text(), quiet, other)[2] == "block_sum-noise=0.2-window=3"
    short = text(trainer={**TRAINER, "steps": 700})
    assert names(text(), short) == ["block_sum-steps=14000", "block_sum-steps=700"]
    assert names(text(TERMINAL), short) == ["terminal-steps=14000", "block_sum-steps=700"]
    noisy = [text({**BLOCK_SUM, "noise": noise}, {**ENV, "noise": 1.0 - noise}) for noise in (0.2, 0.5)]
    assert names(*noisy)[0] == "block_sum-env.noise=0.8-feedback.noise=0.2"
    assert names(text(), text(env={"_target_": "credit.envs.sepsis.environment.Sepsis"})) == [
        "block_sum-advertiser",
        "block_sum-sepsis",
    ]


def test_settings_are_told_as_one_would_type_them():
    other = text(TERMINAL, {**ENV, "interaction": [0.0, 0.1]}, {**TRAINER, "steps": 700})
    usual, found = (name_settings([text(), other])[each] for each in (text(), other))
    assert found.words == "feedback=terminal env.interaction=[0.0,0.1] trainer.steps=700"
    assert usual.words == "feedback=block_sum env.interaction=[0.0,0.02,0.05] trainer.steps=14000"
    own = [("env.interaction", [0.0, 0.1]), ("feedback", "terminal"), ("feedback.window", 5), ("trainer.steps", 700)]
    assert found.own == dict(own)
    assert describe(usual.own) == (
        "env.interaction=[0.0,0.02,0.05]; feedback=block_sum (noise=0.2, window=7); trainer.steps=14000"
    )


def test_a_class_that_moved_is_the_same_and_one_of_another_package_is_not():
    moved = text({**BLOCK_SUM, "_target_": "credit.envs.feedback.BlockSum"})
    assert moved == text()
    theirs = text({**BLOCK_SUM, "_target_": "their.rules.BlockSum"})
    assert names(text(), theirs) == ["block_sum", "their.block_sum"]
    assert names(theirs) == ["block_sum"]


def test_names_can_be_file_names_and_are_never_the_same():
    assert names(text({"_target_": "their.HTTPOutcome"})) == ["http_outcome"]
    odd = [text({"_target_": "credit.Rule", "path": path}) for path in ("a/b c", "d", "a/b-c")]
    found = names(*odd)
    assert found[1] == "rule-path=d"
    assert found[0].startswith("rule-path=a-b-c-")
    assert len(set(found)) == 3
    maps = [text(env={**ENV, "maze": [[1] * 40, [wall] * 40]}) for wall in (0, 1)]
    assert len({*names(*maps)}) == 2
    assert all(len(name) <= 110 for name in names(*maps))


def test_a_component_inside_the_environment_is_part_of_it():
    inner = {"_target_": "credit.envs.wind.Wind", "force": 2}
    assert (
        values_of({"env": {**ENV, "wind": inner}, "feedback": BLOCK_SUM, "trainer": TRAINER}).items()
        >= {
            "env.wind": "wind",
            "env.wind.force": 2,
        }.items()
    )


def test_a_setting_goes_by_its_name_and_that_of_its_rule():
    assert is_called("block_sum-noise=0.2", "block_sum")
    assert is_called("block_sum-noise=0.2", "block_sum-noise=0.2")
    assert not is_called("block_sum-noise=0.2", "block")


def test_settings_are_chosen_by_their_values():
    texts = [text(trainer={**TRAINER, "steps": steps}) for steps in (700, 14000)] + [text(TERMINAL)]
    (chosen,) = choose_settings(texts, "advertiser", where={"trainer.steps": 700}).values()
    assert (chosen.name, chosen.own) == ("block_sum-steps=700", {})
    both = choose_settings(texts, "advertiser", ["block_sum"], {"env.states": 10})
    assert [setting.own for setting in both.values()] == [{"trainer.steps": 14000}, {"trainer.steps": 700}]
    for where, message in (
        ({"trainer.steps": 7}, r"has trainer\.steps=7: there are runs with trainer\.steps=14000 and 700\."),
        ({"env.mace": "Large"}, r"env\.mace is no part of their settings, .*valid: env, env\.convexity"),
        ({"trainer.steps": 700, "feedback.window": 5}, "not together"),
    ):
        with pytest.raises(UserError, match=message):
            choose_settings(texts, "advertiser", where=where)


@pytest.fixture
def output(write_run: WriteRun, tmp_path: Path) -> Path:
    for seed in range(3):
        write_run("reference", seed, REGRET)
        write_run("reference", seed, REGRET, slug="feedback=terminal", feedback=TERMINAL)
        write_run("oracle", seed, REGRET, slug="bonus.x=1,feedback=terminal", feedback=TERMINAL)
    return tmp_path / "outputs"


def test_runs_are_split_by_their_setting(output: Path):
    block, terminal = load_runs(output, "advertiser").by_setting()
    assert (block.setting.name, terminal.setting.name) == ("block_sum", "terminal")
    assert block.frame[["method", "slug"]].drop_duplicates().to_numpy().tolist() == [["reference", "default"]]
    assert terminal.frame[["method", "slug"]].drop_duplicates().to_numpy().tolist() == [
        ["oracle", "bonus.x=1"],
        ["reference", "default"],
    ]
    assert terminal.frame["seed"].tolist() == [0, 1, 2, 0, 1, 2]


def test_one_setting_has_a_name_only_where_it_was_chosen(output: Path):
    (block,) = load_runs(output, "advertiser", slugs=["default"], methods=["reference"]).by_setting(["block_sum"])
    assert block.setting.name == "block_sum"
    (terminal,) = load_runs(output, "advertiser", methods=["oracle"]).by_setting()
    assert terminal.setting.name == "terminal"  # by its overrides
    for folder in (output / "advertiser").glob("*/*feedback=terminal"):
        folder.rename(output / folder.parent.name)
    (alone,) = load_runs(output, "advertiser").by_setting()
    assert alone.setting.name == ""


def test_settings_that_have_no_runs_are_named_with_those_that_have(output: Path):
    with pytest.raises(UserError, match=r"has feedback=termnal; did you mean 'terminal'\? \(valid: block_sum, termin"):
        load_runs(output, "advertiser").by_setting(["block_sum", "termnal"])


def test_slugs_can_be_chosen_without_the_setting(output: Path):
    for slug in ("bonus.x=1", "bonus.x=1,feedback=terminal"):
        assert set(load_runs(output, "advertiser", slugs=[slug]).frame["method"]) == {"oracle"}
    assert len(load_runs(output, "advertiser", slugs=["default"]).frame) == 6


def test_an_override_that_repeats_the_default_is_the_same_run(write_run: WriteRun, output: Path):
    for seed in (2, 3):
        write_run("reference", seed, REGRET, slug="feedback=block_sum", config_hash="hash-of-reference-default")
    block, _ = load_runs(output, "advertiser").by_setting()
    assert block.frame["seed"].tolist() == [0, 1, 2, 3]
    assert len(block.frame["folder"].unique()) == 4


def test_unfinished_runs_are_counted_in_their_setting(write_run: WriteRun, output: Path):
    unfinished = write_run("delayed", 0, REGRET, slug="feedback=terminal", feedback=TERMINAL, done=False)
    new = write_run("delayed", 1, REGRET, slug="feedback.window=2", feedback={**TERMINAL, "window": 2}, done=False)
    damaged = write_run("delayed", 2, REGRET, done=False)
    (damaged / "config.yaml").write_text("", encoding="utf-8")
    block, terminal = load_runs(output, "advertiser").by_setting()
    assert terminal.unfinished == (unfinished,)
    assert set(block.unfinished) == {new, damaged}


@pytest.mark.parametrize("content", ["{", "", "feedback: [", "env: {}", "[1]", "env: 3\nfeedback: 4\ntrainer: {}"])
def test_a_run_without_its_configuration_is_named(output: Path, content: str):
    path = output / "advertiser/oracle/bonus.x=1,feedback=terminal/seed-0/config.yaml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its config\.yaml cannot be used"):
        load_runs(output, "advertiser")


def test_what_runs_start_from_makes_a_setting_where_it_is_given():
    base = {"feedback": BLOCK_SUM, "env": ENV, "trainer": TRAINER}
    without, none, given = (
        json.dumps(values_of(config), sort_keys=True)
        for config in (base, {**base, "demonstrations_from": None}, {**base, "demonstrations_from": "logs/a.csv"})
    )
    assert without == none != given
    assert names(without, given) == ["block_sum", "block_sum-demonstrations_from=logs-a.csv"]
    found = name_settings([without, given])[given]
    assert found.words == "feedback=block_sum demonstrations_from=logs/a.csv"
    assert describe(json.loads(given)).endswith("; demonstrations_from=logs/a.csv")
    assert has(given, {"demonstrations_from": "logs/a.csv"})
    assert not has(without, {"demonstrations_from": "logs/a.csv"})


def test_a_budget_that_says_nothing_is_no_part_of_a_setting():
    """Runs from before there were episodes have the same setting as those of today."""
    config = {slot: {"_target_": f"credit.{slot}.Some"} for slot in PROBLEM}
    old = config | {"trainer": {"_target_": "credit.trainer.Trainer", "steps": 70}}
    new = config | {"trainer": old["trainer"] | {"episodes": None}}
    assert values_of(new) == values_of(old)
    other = values_of(config | {"trainer": {"steps": None, "episodes": 10}})
    assert other == dict.fromkeys(PROBLEM, "some") | {"trainer.episodes": 10}
