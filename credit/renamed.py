"""Old names and today's: run folders, YAML files and imports of older versions are understood, or answered.

Light to import: no torch.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.abc import MetaPathFinder
from typing import Any

CLASSES = {  # classes that have another name, or became one with another
    "credit.recovery.RewardRecovery": "credit.recovery.recovery.Recovery",
    "credit.recovery.recovery.RewardRecovery": "credit.recovery.recovery.Recovery",
    "credit.step_recovery.StepRecovery": "credit.recovery.recovery.Recovery",
    "credit.rewards.step_linear.StepLinear": "credit.recovery.models.linear.LinearModel",
    "credit.rewards.step_primitive.StepPrimitive": "credit.recovery.models.primitive.PrimitiveReward",
    "credit.transitions.Exact": "credit.planning.exact.Exact",
    "credit.transitions.FactoredMixture": "credit.envs.sepsis.factored.FactoredMixture",
    "credit.transitions.ShiftMixture": "credit.envs.advertiser.shift.ShiftMixture",
}
SAID = {  # old target → keys that were not said then, since they were part of the class
    "credit.rewards.step_linear.StepLinear": {
        "uncertainty": {"_target_": "credit.recovery.uncertainty.bootstrap.Analytic", "noise": None}
    },
}
WORDS = {  # group, group=option, or key → what to write instead
    "recovery": "one recovery serves all problems: leave it out, or write assigner=recovery",
    "oracle": "one model serves all oracles: leave it out, or write reward@reference=primitive",
    "planner": "write agent=…; an experiment says choose: {planner: …}",
    "learner": "write agent=…; an experiment says choose: {learner: …}",
    "env.poison": "nothing that a learner is given holds a primitive reward; leave it out",
    "assigner=step_recovery": "assigner=recovery",
    "reward=primitive_steps": "reward@reference=primitive",
    "tuned": "a key has one name; an experiment says its value there: defaults_for: {mixer/relative_mse.alpha: …}",
    "tuned.window": "now feedback.window",
    "tuned.noise": "now feedback.noise",
    "tuned.prior_variance": "now uncertainty.prior_variance",
    "tuned.mixer_alpha": "now mixer.alpha",
    "tuned.count_scale": "now bonus.count.scale",
    "tuned.oracle_scale": "now bonus.count.scale",
    "tuned.elliptical_scale": "now bonus.elliptical.scale",
    "tuned.structure_counts": "now transition.pseudo_counts",
    "tuned.model_scale": "now bonus.disagreement.scale, or bonus.local_mse.scale",
    "tuned.reference_scale": "now bonus.local_mse.scale",
    "tuned.lambda_visits": "now bonus.disagreement.lambda_visits, or bonus.local_mse.lambda_visits",
}
SLOTS = {"optimizer": "agent"}  # a group, and the key that its options fill
GONE = {"poison"}  # keys that decided nothing
MODULES = {
    "credit.optimizers": "credit.agents",
    "credit.optimizers.sac": "credit.agents.sac",
    "credit.redistribution": "credit.rivals",
    "credit.report.maze": "credit.report.pointmaze",
    "credit.rewards": "credit.recovery.models",
    "credit.rewards.features": "credit.recovery.features",
    "credit.agents.sac.optimizer": "credit.agents.sac.agent",
    "credit.agents.torchrl.images": "credit.networks.images",
    "credit.agents.torchrl.networks": "credit.networks.modules",
    "credit.alike": "credit.recovery.tables",
    "credit.artifacts": "credit.runs.artifacts",
    "credit.bonuses": "credit.recovery.bonuses",
    "credit.cells": "credit.core.cells",
    "credit.checkpoint": "credit.runs.checkpoint",
    "credit.component": "credit.core.component",
    "credit.continuous": "credit.core.seams",
    "credit.dataset": "credit.core.store",
    "credit.envs.advertiser": "credit.envs.advertiser.environment",
    "credit.envs.episodic": "credit.envs.exact.episodic",
    "credit.envs.exact": "credit.envs.exact.base",
    "credit.envs.pointmaze.oracle": "credit.judges.rollouts",
    "credit.envs.pointmaze.rounds": "credit.envs.episodes",
    "credit.envs.sepsis": "credit.envs.sepsis.environment",
    "credit.envs.tabular": "credit.envs.exact.continuing",
    "credit.errors": "credit.core.errors",
    "credit.feedback": "credit.envs.feedback",
    "credit.interfaces": "credit.core.seams",
    "credit.job": "credit.runs.job",
    "credit.launchers": "credit.config.launchers",
    "credit.loading": "credit.runs.load",
    "credit.locks": "credit.runs.locks",
    "credit.metrics": "credit.judges.exact",
    "credit.mixers": "credit.recovery.mixers",
    "credit.network_uncertainty": "credit.recovery.uncertainty.networks",
    "credit.networks.draws": "credit.core.draws",
    "credit.optimizers.block_ucb": "credit.agents.block_ucb",
    "credit.optimizers.dqn": "credit.agents.dqn",
    "credit.optimizers.finite_horizon": "credit.agents.finite_horizon",
    "credit.optimizers.q_learning": "credit.agents.q_learning",
    "credit.optimizers.random": "credit.agents.random",
    "credit.optimizers.replay": "credit.data.replay",
    "credit.optimizers.sac.buffer": "credit.data.replay",
    "credit.optimizers.sac.learner": "credit.agents.sac.learner",
    "credit.optimizers.sac.loss": "credit.agents.sac.loss",
    "credit.optimizers.sac.networks": "credit.agents.sac.networks",
    "credit.optimizers.sac.optimizer": "credit.agents.sac.agent",
    "credit.optimizers.sac.policy": "credit.agents.sac.policy",
    "credit.optimizers.value_iteration": "credit.agents.value_iteration",
    "credit.planning": "credit.planning.solve",
    "credit.recovery": "credit.recovery.recovery",
    "credit.redistribution.rules": "credit.rivals.rules",
    "credit.registry": "credit.config.registry",
    "credit.report.maze.figures": "credit.report.pointmaze.figures",
    "credit.report.maze.maps": "credit.report.pointmaze.maps",
    "credit.report.maze.pictures": "credit.report.pointmaze.pictures",
    "credit.report.maze.render": "credit.report.pointmaze.render",
    "credit.report.maze.tracks": "credit.report.pointmaze.tracks",
    "credit.report.maze.videos": "credit.report.pointmaze.videos",
    "credit.resuming": "credit.runs.resume",
    "credit.rewards.batches": "credit.recovery.models.batches",
    "credit.rewards.features.clinical": "credit.envs.sepsis.features",
    "credit.rewards.features.maze": "credit.envs.pointmaze.features",
    "credit.rewards.features.motion": "credit.recovery.features.motion",
    "credit.rewards.features.tabular": "credit.recovery.features.tabular",
    "credit.rewards.linear": "credit.recovery.models.linear",
    "credit.rewards.neural": "credit.recovery.models.neural",
    "credit.rewards.primitive": "credit.recovery.models.primitive",
    "credit.rewards.step_linear": "credit.recovery.models.linear",
    "credit.rewards.step_primitive": "credit.recovery.models.primitive",
    "credit.rewards.table": "credit.recovery.models.table",
    "credit.runner": "credit.runs.runner",
    "credit.runs": "credit.runs.folders",
    "credit.scaler": "credit.recovery.scaler",
    "credit.schema": "credit.config.schema",
    "credit.session": "credit.runs.session",
    "credit.signals": "credit.runs.signals",
    "credit.config.signatures": "credit.core.signatures",
    "credit.signatures": "credit.core.signatures",
    "credit.stateful": "credit.core.state",
    "credit.step_recovery": "credit.recovery.recovery",
    "credit.streams": "credit.core.streams",
    "credit.tables": "credit.core.seams",
    "credit.tensors": "credit.core.tensors",
    "credit.tracking.journal": "credit.runs.journal",
    "credit.trajectories": "credit.core.store",
    "credit.transitions": "credit.planning.counts",
    "credit.transitions.counts": "credit.planning.counts",
    "credit.transitions.exact": "credit.planning.exact",
    "credit.transitions.factored": "credit.envs.sepsis.factored",
    "credit.transitions.shift": "credit.envs.advertiser.shift",
    "credit.types": "credit.core.problem",
    "credit.uncertainty": "credit.recovery.uncertainty.bootstrap",
    "credit.work": "credit.runs.work",
}


def today(target: str) -> str:
    """Today's name of a class that was called `target`; the same if it still is.

    Example:
        >>> today("credit.bonuses.Count")
        'credit.recovery.bonuses.Count'
    """
    module, _, name = target.rpartition(".")
    return CLASSES.get(target) or (f"{MODULES[module]}.{name}" if module in MODULES else target)


def instead(word: str) -> str | None:
    """What to write for an override whose group, option or key is gone; None where it is not.

    Example:
        >>> instead("tuned.mixer_alpha=.3")
        'now mixer.alpha'
        >>> instead("optimizer.discount=.9")
        'now agent.discount'
    """
    name, _, value = word.lstrip("+~").partition("=")
    group = name.partition("@")[0]
    slot, dot, key = group.partition(".")
    if slot in SLOTS:
        return f"now {SLOTS[slot]}{dot}{key}"
    return WORDS.get(group) or WORDS.get(f"{group}={value}") or WORDS.get(slot)


def translated(config: Mapping[str, Any]) -> dict[str, Any]:
    """A whole configuration of any version, as today's code would have written it; what is not understood stays."""
    return {SLOTS.get(slot, slot): _translated(value) for slot, value in config.items()}


def _translated(node: Any) -> Any:
    """A component, with all that is in it."""
    if isinstance(node, Mapping):
        found = {key: _translated(value) for key, value in node.items()}
        if isinstance(target := found.get("_target_"), str):
            found = {key: value for key, value in found.items() if key not in GONE}
            found = {**SAID.get(target, {}), **found, "_target_": today(target)}
        return found
    return [_translated(value) for value in node] if isinstance(node, list) else node


class Answers(MetaPathFinder):
    """Says where a module has gone; asked only where Python has found none."""

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> None:
        """Never finds anything.

        Raises:
            ModuleNotFoundError: the module has another name now.
        """
        if fullname in MODULES:
            raise ModuleNotFoundError(f"{fullname} is {MODULES[fullname]} since credit 0.2", name=fullname)


def answer_old_imports() -> None:
    """`import credit.mixers` says where it is now."""
    if not any(isinstance(finder, Answers) for finder in sys.meta_path):
        sys.meta_path.append(Answers())
