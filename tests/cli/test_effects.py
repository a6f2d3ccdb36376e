"""What is typed has an effect, in the spelling in which `check --explain` prints it; what has none is refused."""

from __future__ import annotations

import pytest

from credit.config import registry
from credit.config.identity import identity
from credit.core.errors import UserError
from credit.runs.composing import compose


def test_jobs_of_a_sweep_in_which_a_word_has_no_effect_are_one(credit):
    ended = credit("check", "-m", "method=delayed,adaptive_mse", "mixer.alpha=.1,.3", "tracking=none")
    assert ended.code == 0, ended.err
    assert ended.out.splitlines() == [
        "method=delayed tracking=none",
        "method=adaptive_mse mixer.alpha=0.1 tracking=none",
        "method=adaptive_mse mixer.alpha=0.3 tracking=none",
        "# 3 jobs, all right",
    ]


def test_so_are_those_that_do_not_have_the_part_at_all(credit):
    ended = credit("check", "-m", "method=random,reference", "bonus.count.scale=.1,.2", "tracking=none")
    assert ended.code == 0, ended.err
    assert ended.out.splitlines() == [
        "method=random tracking=none",
        "method=reference bonus.count.scale=0.1 tracking=none",
        "method=reference bonus.count.scale=0.2 tracking=none",
        "# 3 jobs, all right",
    ]
    refused = credit("check", "-m", "method=random,reference", "bonus.cuont.scale=.1", "tracking=none")
    assert refused.code == 2
    assert "did you mean 'count'?" in refused.err


def test_a_run_from_python_refuses_what_has_no_effect():
    with pytest.raises(UserError, match=r"'mixer=best' has no effect: method=delayed uses no mixer"):
        compose(["method=delayed", "mixer=best", "tracking=none"])


@pytest.mark.parametrize("method", [pytest.param("adaptive_mse", marks=pytest.mark.thorough), "delayed"])
@pytest.mark.parametrize(
    "experiment", ["advertiser", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("sepsis", "pointmaze"))]
)
def test_whatever_explain_lists_can_be_typed_as_it_stands(credit, experiment, method):
    words = (f"experiment={experiment}", f"method={method}", "tracking=none")
    listed = credit("check", "--explain", *words).out.splitlines()[:-1]
    chosen = {"experiment", "method", "slug", "session"}  # by their options, by what differs, by the command
    keys = [key for line in listed if (key := line.split()[0]) not in chosen and not key.endswith("_target_")]
    assert len(keys) > 20
    typed = registry.compose([*words, *(f"{key}=null" for key in keys)])  # at once: composing takes most of a test
    for key in keys:
        config = typed
        for part in key.split("."):
            config = config[part]
        assert config is None, key


def test_a_list_may_be_emptied():
    config = compose(["method=disagreement", "bonus=[]", "tracking=none"])
    assert config["bonus"] == {}
    assert identity(config) == identity(compose(["method=disagreement", "bonus=none", "tracking=none"]))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("check", "mixer.alpha=.5", "mixer.alpha=.6"),
            "'mixer.alpha=.5' has no effect, since 'mixer.alpha=.6' is given",
        ),
        (("train", "-m", "seed=0", "+seed=1,2"), "'seed=0' has no effect, since '+seed=1,2' is given, too"),
        (("check", "mixer=best", "mixer=best"), "'mixer=best' has no effect"),
        (("train", "hydra.run.dir=/nowhere"), "'hydra.run.dir=/nowhere' has no effect: of Hydra's settings only"),
        (("train", "-m", "seed=0,1", "hydra.verbose=true"), "'hydra.verbose=true' has no effect"),
        (("check", "hydra/sweeper=optuna"), "'hydra/sweeper=optuna' has no effect"),
        (
            ("compare", "method=delayed", "method=reference"),
            "method is given twice ('method=delayed' and 'method=refer",
        ),
        (("compare", "trapped_above=nan"), "trapped_above=nan: expected a finite number"),
        (("compare", "trapped_above=inf"), "trapped_above=inf: expected a finite number"),
    ],
)
def test_what_is_typed_has_an_effect_or_is_an_error(credit, folder, words, said):
    ended = credit(*words)
    assert ended.code == 2
    assert said in ended.err
    assert not [*folder.iterdir()]
