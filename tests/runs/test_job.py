"""One job: whole-configuration checks, identity, and what of it is already done."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from credit.config import registry
from credit.config.identity import plain
from credit.core.errors import UserError
from credit.runs import job

Composed = Callable[..., dict[str, Any]]


def problems(*overrides: str) -> list[str]:
    return job.check(registry.compose(["tracking=none", *overrides])).problems


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("feedback.window=0", ["feedback.window=0", "int ≥ 1"]),
        ("replicas=0", ["replicas=0", "int ≥ 1"]),
        ("seed=-1", ["seed=-1", "int ≥ 0"]),
        ("uncertainty.draws=0", ["uncertainty.draws=0", "int ≥ 1"]),
        ("reference.regularization=-0.1", ["reference.regularization=-0.1", "float > 0"]),
        ("bonus.count.lambda_visits=-1", ["bonus.count.lambda_visits=-1", "float > 0"]),
        ("mixer.alpha=abc", ["mixer.alpha='abc'", "float > 0"]),
        ("mixer.alpha=0", ["mixer.alpha=0", "float > 0"]),
        ("+mixer.alfa=1", ["mixer.alfa", "unknown key", "did you mean 'alpha'"]),
        ("+surrogates.linear.features.foo=1", ["surrogates.linear.features.foo", "unknown key"]),
        ("trainer.steps=6", ["trainer.steps=6", "feedback.window=7"]),
        ("agent.discount=1.5", ["agent.discount=1.5", "float > 0 and ≤ 1"]),
        ("uncertainty.resample=jackknife", ["uncertainty.resample='jackknife'", "one of poisson, exact"]),
        ("env.interaction=[0,x]", ["env.interaction=[0, 'x']", "list of float"]),
        ("env.p_mid_up=0.9", ["p_mid_down", "1.2", "at most 1"]),
        ("device=tpu9", ["device='tpu9'", "cpu, cuda, cuda:<n>, auto"]),
        ("device=cuda:99", ["device='cuda:99'", "CUDA devices are visible"]),
        ("env.p_down=???", ["env.p_down", "a value is missing"]),
        (
            "agent=sac",
            ["agent: SAC needs actions that are vectors (Box)", "numbers (Discrete)"],
        ),
        ("reference._target_=os.system", ["reference._target_='os.system'", "only classes of these packages"]),
        ("surrogates.linear.name=ridge", ["different names", "ridge"]),
    ],
)
def test_a_problem_is_named(override: str, said: list[str]) -> None:
    found = problems(override)
    assert len(found) == 1, found
    for part in said:
        assert part in found[0], found[0]


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["method=block", "feedback.window=12"], r"feedback\.window=12.*3\^12"),
        (["method=reference", "reward@reference=dnn"], r"reference: NeuralModel needs a NetworkUncertainty"),
        (
            ["method=reference", "reward@reference=primitive", "bonus=[thompson]"],
            r"bonus\.thompson.*LinearModel.*PrimitiveReward",
        ),
    ],
)
def test_parts_that_do_not_fit(overrides: list[str], said: str) -> None:
    with pytest.raises(UserError, match=said):
        job.checked(registry.compose(["tracking=none", *overrides]))


def test_null_for_a_nested_component() -> None:
    assert problems("reference.features=null")


@pytest.mark.parametrize("override", ["env.gain=.06", "env.interaction=[0,.05]", "env.crowding=0"])
def test_other_rewards_are_allowed(override: str) -> None:
    assert problems(override) == []


def test_several_problems_come_together() -> None:
    found = problems("mixer.alpha=-1", "replicas=0", "+env.foo=3", "surrogates.linear.regularization=x")
    assert len(found) == 4
    with pytest.raises(UserError) as error:
        job.checked(registry.compose(["tracking=none", "mixer.alpha=-1", "replicas=0"]))
    assert "mixer.alpha=-1" in str(error.value)
    assert "replicas=0" in str(error.value)


def test_the_output_folder(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("x", encoding="utf-8")
    for output in (file, file / "inside"):
        (found,) = problems(f"output={output}")
        assert str(file) in found
        assert "is a file" in found
    assert problems(f"output={tmp_path / 'deep' / 'down'}") == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]  # a check makes nothing
    (found,) = problems("output=/proc/nothing/here")
    assert "not writable" in found


def test_the_checked_configuration_has_what_is_used(composed: Composed) -> None:
    assert {"reference", "surrogates", "bonus", "transition"} <= composed("method=disagreement").keys()
    assert not {"reference", "surrogates", "mixer", "bonus", "transition"} & composed("method=delayed").keys()


def test_identity_ignores_circumstances(composed: Composed) -> None:
    config = composed("method=reference")
    same = config | {"seed": 9, "replicas": 3, "output": "x", "device": "cuda", "rerun": True, "session": "s"}
    assert job.identity(same | {"tracking": {"_target_": "other"}}) == job.identity(config)
    assert len(job.identity(config)) == 12
    assert job.identity(dict(reversed(config.items()))) == job.identity(config)  # the order of keys decides nothing


@pytest.mark.parametrize("override", ["mixer.alpha=.4", "trainer.steps=7000", "env.states=9", "bonus.count.scale=.3"])
def test_identity_is_of_everything_else(composed: Composed, override: str) -> None:
    assert job.identity(composed("method=disagreement", override)) != job.identity(composed("method=disagreement"))


@pytest.mark.parametrize("rows", ["[1111,1001,1111]", "[[1,1,1,1],[1,0,0,1],[1,1,1,1]]", "['1111','1001','1111']"])
def test_a_map_may_be_rows_of_any_kind(rows: str) -> None:
    none = [f"env.{kind}=0" for kind in ("successes", "partials", "failures")]
    assert not problems("experiment=pointmaze", f"env.maze={rows}", "env.goal=[1,2]", *none)


def test_long_rows_of_digits_are_told_apart() -> None:
    one, other = ([10**30, row, 10**30] for row in (10**30 + 1, 10**30 + 3))
    assert plain(one) != plain(other)
    assert plain([10, 3]) == [10.0, 3.0]


def test_what_a_method_does_not_use_is_no_part_of_it(composed: Composed) -> None:
    assert job.identity(composed("method=delayed", "mixer.alpha=.4")) == job.identity(composed("method=delayed"))


@pytest.mark.parametrize("method", ["credit_hypotheses", "last_step"])
def test_a_method_written_for_one_experiment(composed: Composed, method: str) -> None:
    (found,) = problems("experiment=advertiser", f"method={method}", "replicas=0")  # the rest does not matter
    assert found.startswith(f"method={method} is written for experiment=sepsis only, and the experiment is advertiser")
    assert "credit list" in found
    config = composed("experiment=sepsis", f"method={method}")
    assert job.Job.of(config).written_for == "sepsis"
    assert job.identity(config | {"written_for": None}) == job.identity(config)  # runs from before the key are kept
    assert problems("experiment=advertiser", f"method={method}", "written_for=null")  # its parts do not fit either
    assert job.Job.of(composed("experiment=sepsis", "method=disagreement")).written_for is None


def test_plain_keys(composed: Composed) -> None:
    found = job.Job.of(composed("method=reference", "seed=4", "replicas=3"))
    assert found.seeds == (4, 5, 6)
    assert (found.method, found.experiment, found.title) == ("reference", "advertiser", "Ridge-UCB")
    assert found.folder.is_absolute()


def leave(folder: Path, config: dict[str, Any], done: bool) -> None:
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    if done:
        (folder / "DONE").write_text("x", encoding="utf-8")


def test_split_skips_what_is_done(composed: Composed, tmp_path: Path) -> None:
    config = composed("method=reference", "replicas=4")
    assert job.split(config, tmp_path) == ([0, 1, 2, 3], [])
    leave(tmp_path / "seed-1", config | {"seed": 1, "replicas": 1, "output": "elsewhere"}, done=True)
    leave(tmp_path / "seed-2", config | {"seed": 2, "replicas": 1}, done=False)  # begun, not finished
    assert job.split(config, tmp_path) == ([0, 2, 3], [1])
    assert job.split(config | {"rerun": True}, tmp_path) == ([0, 1, 2, 3], [])


@pytest.mark.parametrize("done", [True, False])
def test_split_refuses_another_configuration(composed: Composed, tmp_path: Path, done: bool) -> None:
    config = composed("method=reference", "replicas=2")
    leave(tmp_path / "seed-1", composed("method=reference", "mixer=uniform", "env.cost=.06"), done)
    with pytest.raises(UserError) as error:
        job.split(config, tmp_path)
    for part in ("seed-1", "another configuration", "env.cost: 0.06 → 0.05", "Nothing was overwritten", "rerun=true"):
        assert part in str(error.value)
    assert job.split(config | {"rerun": True}, tmp_path) == ([0, 1], [])


def test_differences(composed: Composed) -> None:
    earlier, now = composed("method=delayed"), composed("method=delayed", "agent.epsilon=.5", "seed=4")
    assert job.differences(earlier, now) == ["agent.epsilon: 1.0 → 0.5"]
    assert job.differences(now, now) == []


def test_devices() -> None:
    assert job.device("cpu") == torch.device("cpu")
    assert job.device("auto").type in ("cpu", "cuda")


def test_jobs_take_turns_at_the_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 3)
    assert [job.device("cuda", number).index for number in range(5)] == [0, 1, 2, 0, 1]
    assert job.device("auto", 4) == torch.device("cuda:1")
    assert job.device("cuda:2", 4) == torch.device("cuda:2")
    assert job.device("cpu", 4) == torch.device("cpu")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert job.device("auto", 4) == torch.device("cpu")
