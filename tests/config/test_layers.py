"""What experiments and methods want of parts that may not be chosen, and which word counts more than which."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from credit.config import files, kinds, registry
from credit.config.layers import Layer
from credit.core.errors import UserError
from credit.runs import job
from credit.runs.composing import compose

Write = Callable[[str, str], None]
MIXER = "_target_: credit.recovery.mixers.RelativeMSE\n"


@pytest.fixture
def own(tmp_path: Path) -> str:
    return str(tmp_path)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def put(name: str, text: str) -> None:
        path = tmp_path / f"{name}.yaml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"{text}\n", encoding="utf-8")

    return put


def composed(experiment: str, method: str) -> dict[str, Any]:
    return registry.compose([f"experiment={experiment}", f"method={method}"])


@pytest.mark.parametrize(
    ("words", "agent"),
    [
        ("experiment=advertiser method=disagreement", "ValueIteration"),
        ("experiment=sepsis method=disagreement", "FiniteHorizon"),
        ("experiment=sepsis method=delayed", "DQN"),
        ("experiment=pointmaze_paper method=reference", "SAC"),
        ("experiment=sepsis method=disagreement agent=dqn", "DQN"),
        ("agent=dqn experiment=sepsis method=disagreement", "DQN"),
    ],
)
def test_roles(words: str, agent: str) -> None:
    assert registry.compose(words.split())["agent"]["_target_"].rpartition(".")[2] == agent


def test_titles_call_roles_by_the_experiments_names() -> None:
    titles = {
        (experiment, method): composed(experiment, method)["title"]
        for experiment in ("advertiser", "sepsis", "pointmaze")
        for method in ("reference", "delayed_fair", "disagreement")
    }
    assert titles == {
        ("advertiser", "reference"): "Ridge-UCB",
        ("advertiser", "delayed_fair"): "Delayed Q-learning (tuned)",
        ("advertiser", "disagreement"): "Disagreement-UCB",
        ("sepsis", "reference"): "Ridge-UCB",
        ("sepsis", "delayed_fair"): "Delayed DQN (tuned)",
        ("sepsis", "disagreement"): "Disagreement-UCB",
        ("pointmaze", "reference"): "DNN-reference SAC",
        ("pointmaze", "delayed_fair"): "Delayed SAC (tuned)",
        ("pointmaze", "disagreement"): "Disagreement-SAC",
    }


def test_titles_call_another_agent_by_its_option() -> None:
    titles = [
        registry.compose([*words.split(), "tracking=none"])["title"]
        for words in ("method=delayed agent=dqn", "method=delayed agent=q_learning", "method=disagreement agent=random")
    ]
    assert titles == ["Delayed dqn", "Delayed Q-learning", "Disagreement-random"]


def test_two_options_of_one_group_have_two_values() -> None:
    scales = {
        (experiment, method): composed(experiment, method)["bonus"]["count"]["scale"]
        for experiment in ("advertiser", "sepsis")
        for method in ("disagreement", "oracle")
    }
    assert scales == {
        ("advertiser", "disagreement"): 0.35,
        ("advertiser", "oracle"): 0.2,
        ("sepsis", "disagreement"): 0.03,
        ("sepsis", "oracle"): 0.03,
    }


def test_rank(write: Write, own: str) -> None:
    """Constructor, our file, experiment, method, the user's own file, command line."""
    write("experiment/theirs", "# @package _global_\ndefaults: [advertiser]\nexperiment: theirs")

    def alpha(*words: str) -> object:
        return registry.compose(["experiment=theirs", "method=their_method", *words], [own])["mixer"].get("alpha")

    write("method/their_method", "# @package _global_\ndefaults: [disagreement]\nmethod: their_method")
    assert alpha() == 0.5
    wish = "defaults_for: {mixer/relative_mse.alpha: 0.4}"
    write("experiment/theirs", f"# @package _global_\ndefaults: [advertiser, _self_]\nexperiment: theirs\n{wish}")
    assert alpha() == 0.4
    wish = "defaults_for: {mixer/*.alpha: 0.3}"
    write("method/their_method", f"# @package _global_\ndefaults: [disagreement, _self_]\nmethod: their_method\n{wish}")
    assert alpha() == 0.3
    write("mixer/mine", f"{MIXER}alpha: 0.2")
    assert alpha("mixer=mine") == 0.2
    assert alpha("mixer=mine", "mixer.alpha=.1") == 0.1
    write("mixer/mine", "defaults: [relative_mse, _self_]\nalpha: 0.2")
    assert alpha("mixer=mine") == 0.2
    write("mixer/mine", "defaults: [relative_mse, _self_]\nepsilon: 1.0e-9")  # what it does not say, it inherits
    assert alpha("mixer=mine") == 0.3
    write("mixer/mine", MIXER)
    assert alpha("mixer=mine") is None  # the constructor's
    write("mixer/relative_mse", f"{MIXER}alpha: 0.25")  # the user's own, in place of ours
    assert alpha() == 0.25
    assert files.options("mixer", [own])["relative_mse"] == Path(own) / "mixer/relative_mse.yaml"


def test_of_two_folders_the_last_counts(tmp_path: Path) -> None:
    for name, alpha in (("one", 0.1), ("two", 0.2)):
        (tmp_path / name / "mixer").mkdir(parents=True)
        (tmp_path / name / "mixer" / "mine.yaml").write_text(f"{MIXER}alpha: {alpha}\n")
    folders = [str(tmp_path / name) for name in ("one", "two")]
    assert registry.compose(["mixer=mine"], folders)["mixer"]["alpha"] == 0.2
    assert files.options("mixer", folders)["mine"] == tmp_path / "two/mixer/mine.yaml"


def test_what_every_run_starts_from_is_ours(write: Write, own: str) -> None:
    write("config", "hydra: {}\nnothing: 3")
    assert registry.compose([], [own]) == registry.compose([])


def test_a_file_that_changed_is_read_again(write: Write, own: str) -> None:
    for alpha in (0.1, 0.22):
        write("mixer/mine", f"{MIXER}alpha: {alpha}")
        assert registry.compose(["mixer=mine"], [own])["mixer"]["alpha"] == alpha


def test_a_nested_key_and_a_wish_for_every_option(write: Write, own: str) -> None:
    wish = "defaults_for: {reward/threshold.regularization: 2.0, features/threshold.threshold: 3, feedback/*.window: 4}"
    write("experiment/theirs", f"# @package _global_\ndefaults: [advertiser, _self_]\nexperiment: theirs\n{wish}")
    config = registry.compose(["experiment=theirs"], [own])
    assert config["surrogates"]["threshold"]["regularization"] == 2.0
    assert config["surrogates"]["threshold"]["features"]["threshold"] == 3
    assert config["feedback"]["window"] == 4
    assert registry.compose(["experiment=theirs", "feedback=terminal"], [own])["feedback"]["window"] == 4
    write("feedback/mine", "_target_: credit.envs.feedback.Terminal\nwindow: 9")
    assert registry.compose(["experiment=theirs", "feedback=mine"], [own])["feedback"]["window"] == 9


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("defaults_for: {bonus/cuont.scale: 1}", r"/theirs.yaml: .*bonus has no option 'cuont'.*did you mean 'count'"),
        ("defaults_for: {scaler/stable.clop: 1}", r"file .*/theirs.yaml: .*scaler/stable has no key 'clop'"),
        ("defaults_for: {scaler/*.clop: 1}", r"scaler/\* has no key 'clop'; did you mean 'clip'"),
        ("defaults_for: {bonsu/count.scale: 1}", r"'bonsu' is no group; did you mean 'bonus'"),
        ("defaults_for: {bonus.count.scale: 1}", r"is no key of an option; write GROUP/OPTION\.KEY"),
        ("defaults_for: [bonus/count.scale]", r"defaults_for=.*a mapping belongs here"),
        ("defaults_for: {mixer/relative_mse.alhpa: 1}", r"mixer/relative_mse has no key .alhpa.; did you mean .alpha."),
        ("choose: sac", r"choose='sac': a mapping belongs here"),
        ("choose: {planner: value_itertion}", r"agent=value_itertion: no such option; did you mean"),
        ("x: [", r"theirs\.yaml: no YAML"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_an_experiment_is_explained(text: str, said: str, write: Write, own: str) -> None:
    write("experiment/theirs", f"# @package _global_\ndefaults: [advertiser, _self_]\nexperiment: theirs\n{text}")
    with pytest.raises(UserError, match=said):
        job.checked(registry.compose(["experiment=theirs", "tracking=none"], [own]))


def test_a_role_that_nobody_has_is_explained(write: Write, own: str) -> None:
    entries = "defaults: [{override /agent: '${choose.plannr}'}]"
    write("method/theirs", f"# @package _global_\n{entries}\nmethod: theirs")
    with pytest.raises(UserError, match=r"method=theirs: .*role 'plannr'.*did you mean 'planner'"):
        registry.compose(["method=theirs"], [own])


def test_a_file_that_starts_from_itself_is_explained(write: Write, own: str) -> None:
    write("mixer/relative_mse", "defaults: [relative_mse, _self_]\nalpha: 0.2")
    with pytest.raises(UserError, match="relative_mse"):
        registry.compose([], [own])
    write("experiment/round", "# @package _global_\ndefaults: [round]\nexperiment: round")
    with pytest.raises(UserError, match="round"):
        registry.compose(["experiment=round"], [own])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("defaults: [advertiser, {override /planner: sac}]", "planner: this is gone; .*choose: {planner"),
        ("defaults: [advertiser, _self_]\ntuned: {mixer_alpha: 0.3}", "mixer_alpha: this is gone; now mixer.alpha"),
        ("defaults: [advertiser, _self_]\nfeedback: {noise: '${tuned.noise}'}", "this is gone; now feedback.noise"),
    ],
)  # fmt: skip
def test_an_old_experiment_is_answered(text: str, said: str, write: Write, own: str) -> None:
    write("experiment/theirs", f"# @package _global_\n{text}\nexperiment: theirs")
    with pytest.raises(UserError, match=said):
        job.checked(registry.compose(["experiment=theirs", "tracking=none"], [own]))


def test_an_environment_without_an_experiment(write: Write, own: str) -> None:
    text = (files.conf_dir() / "env/advertiser.yaml").read_text(encoding="utf-8")
    write("env/shop", text.replace("gain: 0.05", "gain: 0.06"))
    config = job.checked(registry.compose(["env=shop", "tracking=none"], [own]))
    assert (config["experiment"], config["env"]["gain"]) == ("shop", 0.06)
    assert registry.compose(["env=shop", "experiment=sepsis"], [own])["experiment"] == "sepsis"
    assert registry.compose(["env=sepsis"])["experiment"] == "sepsis"  # which has one
    assert registry.compose(["experiment=generic", "env=sepsis"])["experiment"] == "generic_sepsis"
    assert registry.compose([])["experiment"] == "advertiser"
    with pytest.raises(UserError, match="needs an environment"):
        registry.compose(["experiment=generic"])


OURS = [(kind, name) for kind in ("experiment", "method") for name in files.options(kind)]


@pytest.mark.parametrize(("kind", "name"), OURS)
def test_values_of_components_stand_in_files_or_wishes(kind: str, name: str) -> None:
    """Else they would count more than a user's own file."""
    slots = {slot for each in kinds.KINDS.values() for slot in each.slots}
    assert not files.read(files.options(kind)[name]).keys() & slots


@pytest.mark.parametrize(("kind", "name"), OURS)
def test_every_wish_changes_something(kind: str, name: str) -> None:
    """A key has one default in one place: what a file says already is not said again."""
    own = [
        wish for wish in Layer.of(**{"experiment": "", "method": "", kind: name}).wishes if wish.by == f"{kind}={name}"
    ]
    for wish in own:  # fmt: skip
        group, _, option = wish.option.partition("/")
        said = [files.read(path) for each, path in files.options(group).items() if option in ("*", each)]
        assert any(node.get(wish.key, "…") != wish.value for node in said), wish


def test_a_method_or_an_experiment_that_does_not_say_its_name_has_that_of_its_file(write: Write, own: str) -> None:
    write("method/mine", "# @package _global_\ndefaults: [reference]")
    write("experiment/theirs", "# @package _global_\ndefaults: [sepsis]\ntrainer: {steps: 700}")
    write("method/other", "# @package _global_\ndefaults: [reference]\nmethod: another_name")
    config = registry.compose(["experiment=theirs", "method=mine"], [own])
    assert (config["experiment"], config["method"], config["trainer"]["steps"]) == ("theirs", "mine", 700)
    assert registry.compose(["method=other"], [own])["method"] == "another_name"


@pytest.mark.parametrize("group", ["method", "experiment"])
def test_a_file_that_would_reach_no_other_group_is_explained(group: str, write: Write, own: str) -> None:
    write(f"{group}/mine", "mixer: {alpha: 0.3}")
    with pytest.raises(UserError, match=rf"{group}=mine: its file has to begin with the line `# @package _global_`"):
        registry.compose([f"{group}=mine"], [own])


def test_a_file_that_is_no_yaml_is_named(write: Write, own: str) -> None:
    write("mixer/mine", "alpha: [")
    with pytest.raises(UserError, match=r"mixer/mine\.yaml"):
        registry.compose(["mixer=mine"], [own])


COUNT = "_target_: credit.recovery.bonuses.Count"


@pytest.mark.thorough
@pytest.mark.parametrize("words", ["[count,ucb1]", "[ucb1,count]", "ucb1", "[ucb1]", "[ucb1,ucb2]", "[ucb1,wide]"])
def test_a_file_of_a_group_that_holds_several_has_a_place_of_its_own(words: str, write: Write, own: str) -> None:
    write("bonus/ucb1", f"# Mine.\n{COUNT}\nscale: 0.7")
    write("bonus/ucb2", f"{COUNT}\nscale: 0.8")
    write("bonus/wide", "defaults: [count, _self_]\nscale: 0.9")  # starts from another file, and lies where that does
    config = compose([f"bonus={words}", "tracking=none"], config_dirs=[own])
    scales = {"ucb1": 0.7, "ucb2": 0.8, "wide": 0.9, "count": 0.35}
    expected = {"count" if name == "wide" else name: scales[name] for name in words.strip("[]").split(",")}
    assert {name: node["scale"] for name, node in config["bonus"].items()} == expected
    assert registry.compose([f"bonus={words}", "bonus.ucb1.scale=3"], [own])["bonus"]["ucb1"]["scale"] == 3


def test_a_file_that_fills_the_whole_of_a_group_has_nothing_beside_it(write: Write, own: str) -> None:
    write("bonus/ucb1", f"# @package bonus\n{COUNT}\nscale: 0.7")
    assert compose(["bonus=ucb1", "tracking=none"], config_dirs=[own])["bonus"]["scale"] == 0.7
    with pytest.raises(UserError, match=r"bonus\.count: bonus is one Count already.*`# @package bonus\.NAME`"):
        compose(["bonus=[count,ucb1]", "tracking=none"], config_dirs=[own])
