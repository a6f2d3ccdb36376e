"""Runs that relabel some rows alone go on where they were; and what is noted about a cap at zero."""

from __future__ import annotations

from pathlib import Path

import pytest

from credit.config import registry
from credit.runs import job
from credit.testing.runs import goes_on
from credit.testing.short import composed

PENDULUM = ("env=gymnasium", "env.id=Pendulum-v1", "method=reference", "env.max_steps=12")
CARTPOLE = ("env=gymnasium", "env.id=CartPole-v1", "method=reference", "env.max_steps=12")


@pytest.mark.parametrize(
    "words",
    [
        pytest.param((*PENDULUM, "assigner.relabel=0.3"), marks=pytest.mark.thorough),
        pytest.param((*CARTPOLE, "assigner.relabel=0.3"), marks=pytest.mark.thorough),
        (*CARTPOLE, "assigner.relabel=sampled"),
    ],
)
def test_a_run_that_relabels_some_goes_on_to_the_bit(words: tuple[str, ...], tmp_path: Path) -> None:
    config = composed(*words)
    config = config | {"trainer": config["trainer"] | {"steps": 60, "steps_per_round": 12, "random_steps": 0}}
    config["trainer"] |= {"windows_per_round": 1}
    goes_on(config, tmp_path, (3, 4), slice(1, 2))


@pytest.mark.parametrize(
    ("words", "noted"),
    [
        ((*PENDULUM, "scaler=stable"), True),
        ((*PENDULUM, "scaler=stable", "scaler.quantile=null"), False),
        ((*PENDULUM, "scaler=unit"), False),
        (("experiment=pointmaze", "method=reference"), False),  # to succeed soon is what it is for
    ],
)
def test_a_cap_at_zero_is_noted_where_dying_pays(words: tuple[str, ...], noted: bool) -> None:
    remark = job.check(registry.compose(["tracking=none", *words])).remark
    assert ("scaler without a cap" in remark) == noted
