"""Every name that version 0.1 had is still there, or answered by the new one."""

from __future__ import annotations

import importlib
import importlib.util

import pytest

from credit.config import files, kinds
from credit.core.errors import UserError
from credit.renamed import MODULES as MODULES_NOW
from credit.renamed import answer_old_imports, instead
from credit.runs.composing import compose

# What is gone since commit 6a61dfa: modules (git ls-tree -r 6a61dfa credit), options of conf/, keys of constructors.
MODULES = """
alike artifacts bonuses cells checkpoint component continuous dataset envs.episodic envs.pointmaze.oracle
envs.pointmaze.rounds envs.tabular errors feedback interfaces job launchers loading locks metrics mixers
network_uncertainty networks.draws optimizers optimizers.block_ucb optimizers.dqn optimizers.finite_horizon
optimizers.q_learning optimizers.random optimizers.replay optimizers.sac optimizers.sac.buffer optimizers.sac.learner
optimizers.sac.loss optimizers.sac.networks optimizers.sac.optimizer optimizers.sac.policy optimizers.value_iteration
redistribution redistribution.rules registry report.maze report.maze.figures report.maze.maps report.maze.pictures
report.maze.render report.maze.tracks report.maze.videos resuming rewards rewards.batches rewards.features
rewards.features.clinical rewards.features.maze rewards.features.motion rewards.features.tabular rewards.linear
rewards.neural rewards.primitive rewards.step_linear rewards.step_primitive rewards.table runner scaler schema
session signals signatures stateful step_recovery streams tables tensors tracking.journal trajectories transitions
transitions.counts transitions.exact transitions.factored transitions.shift types uncertainty work
"""
OPTIONS = {
    "assigner": "step_recovery",
    "learner": "dqn q_learning sac",
    "optimizer": "block_ucb block_ucb_lexicographic dqn dqn_monte_carlo dqn_tuned finite_horizon q_learning "
    "q_learning_tuned random sac sac_plain sac_tuned value_iteration",
    "oracle": "primitive primitive_steps",
    "planner": "finite_horizon sac value_iteration",
    "recovery": "recovery step_recovery",
    "reward@reference": "primitive_steps",
}
KEYS = (
    "env.poison",
    "planner.discount",
    "optimizer.discount",
    "learner.epsilon",
    "recovery.uncertainty",
    "tuned.mixer_alpha",
)


@pytest.mark.parametrize("name", MODULES.split())
def test_a_module_that_moved_says_where_it_is(name: str) -> None:
    answer_old_imports()
    assert importlib.util.find_spec(MODULES_NOW[f"credit.{name}"])
    with pytest.raises(ModuleNotFoundError, match=r"credit\.\S+ is credit\.\S+ since credit 0.2"):  # it, or its folder
        importlib.import_module(f"credit.{name}")


@pytest.mark.parametrize("word", [f"{group}={name}" for group, names in OPTIONS.items() for name in names.split()])
def test_an_option_that_is_gone_is_answered(word: str) -> None:
    group, name = word.split("=")
    kind = group.partition("@")[0]
    assert kind not in kinds.KINDS or name not in files.options(kind)
    assert (now := instead(word))
    with pytest.raises(UserError) as refused:
        compose([word, "tracking=none"])
    assert now in str(refused.value)


@pytest.mark.parametrize("key", KEYS)
def test_a_key_that_is_gone_is_answered(key: str) -> None:
    assert (now := instead(key))
    with pytest.raises(UserError) as refused:
        compose([f"{key}=1", "tracking=none"])
    assert now in str(refused.value)


@pytest.mark.parametrize("group", ["optimizer", "planner", "learner", "oracle", "recovery", "tuned"])
def test_list_answers_a_group_that_is_gone(group: str) -> None:
    from credit.cli import list as listing

    with pytest.raises(UserError, match="is gone; "):
        listing.main([group])
