"""The policy that every finished run keeps (`policy.pt`): what acts, and what it takes to let it act again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from credit.config import schema
from credit.core.acting import alone, laid_over
from credit.core.capabilities import parts_of, require
from credit.core.errors import UserError
from credit.core.knowledge import inform
from credit.core.policy import Policy, TablePolicy
from credit.core.problem import Problem
from credit.core.seams import Agent, Environment, Feedback
from credit.envs import inverse
from credit.renamed import translated
from credit.rounds import problem_of
from credit.runs import checkpoint
from credit.runs.journal import read_json
from credit.trainer import Trainer

POLICY = "policy.pt"
TABLES, STATE = "tables", "state"
WHOLE = "a state from which no seed's own part can be taken"


def write(trainer: Trainer, config: Mapping[str, Any], folders: Mapping[int, Path]) -> str:
    """Keep the policies of a finished run: tensors and plain data, with the configuration, in each seed's folder.

    Args:
        trainer: at its end. config: of the job. folders: replica → its folder.

    Returns:
        Why that cannot be, where it cannot; else nothing.
    """
    problem, policies = trainer.problem, trainer.agent.policies()
    tables = _tables(policies, problem)
    try:
        state = {} if tables else trainer.agent.acting()
        checkpoint.only_data(state, "agent")
        one = _one(config, problem) if state and problem.replicas > 1 else None
        for replica, folder in folders.items():
            if tables:
                acts = {TABLES: {name: table[replica].clone() for name, table in tables.items()}}
            else:
                acts = {STATE: alone(state, replica, problem.replicas, one)}
            seed = problem.seeds[replica]
            own = {**config, "seed": seed, "replicas": 1, "rerun": False}
            checkpoint.save(folder / POLICY, {**_facts(problem), "seed": seed, "config": own, **acts}, durable=False)
    except (TypeError, ValueError, LookupError, AttributeError, RuntimeError) as error:  # of somebody's agent
        return f"{type(trainer.agent).__name__} has {WHOLE}: {error}"
    return ""


def _tables(policies: Mapping[str, Policy], problem: Problem) -> dict[str, Tensor]:
    """Name → actions [R, ...] in few bytes, where all policies are tables; those that are the behaviour's are it."""
    if not all(type(policy) is TablePolicy for policy in policies.values()):
        return {}
    found = {name: policy.actions.cpu() for name, policy in policies.items() if isinstance(policy, TablePolicy)}
    same = {name for name, table in found.items() if name != "behaviour" and torch.equal(table, found["behaviour"])}
    kind = torch.uint8 if problem.actions <= 256 else torch.int32
    return {name: table.to(kind) for name, table in found.items() if name not in same}


def _one(config: Mapping[str, Any], problem: Problem) -> dict[str, Any]:
    """What acts of one seed alone, made anew."""
    env, feedback = schema.build(config, "env"), schema.build(config, "feedback")
    rolling = config["trainer"].get("steps_per_round") is not None
    return started(config, env, problem_of(env, feedback, problem.seeds[:1], problem.device, rolling)).acting()


def _facts(problem: Problem) -> dict[str, Any]:
    """What must be the same where a policy acts."""
    return {
        "observations": str(problem.observation_space),
        "actions": str(problem.action_space),
        "horizon": problem.horizon,
    }


def started(config: Mapping[str, Any], env: Environment, problem: Problem) -> Agent:
    """The agent of a configuration, made anew, for an environment that was not started.

    Raises:
        UserError: it does not fit.
    """
    agent: Agent = schema.build(config, "agent")
    parts = list(parts_of(agent, "agent"))
    require({"agent": agent}, problem)
    if any(part.knows is not None for _, part in parts):
        env.start(problem)
        inform(parts, env.knowledge(), type(env).__name__)
    agent.start(problem)
    return agent


class Kept:
    """A kept policy among what it acts in, each made anew from the run's configuration.

    Args:
        content: of `policy.pt`. source: where that lies, for messages.
        config: the run's configuration, or one with another environment.

    Attributes:
        env, feedback: not started. problem: of one seed. policies: by name; `behaviour` is what the run followed.

    Raises:
        UserError: the environment has other spaces than that of the run.
    """

    def __init__(self, content: Mapping[str, Any], source: Path, config: Mapping[str, Any] | None = None) -> None:
        self.seed, self.source, self.config = int(content["seed"]), source, config or content["config"]
        self.env: Environment = schema.build(self.config, "env")
        self.feedback: Feedback = schema.build(self.config, "feedback")
        rolling = self.config["trainer"].get("steps_per_round") is not None
        self.problem = problem_of(self.env, self.feedback, (self.seed,), "cpu", rolling)
        for name, now in _facts(self.problem).items():
            timed = any(table.dim() == 2 for table in content.get(TABLES, {}).values())
            if content[name] != now and (name != "horizon" or timed):
                raise UserError(
                    f"{source}: this policy was learned with {name} {content[name]}, and the environment has {now} "
                    "here; give it one with the same"
                )
        self.policies = self._policies(content)

    def _policies(self, content: Mapping[str, Any]) -> dict[str, Policy]:
        if TABLES in content:
            count = self.problem.actions
            return {name: TablePolicy(table.long()[None], count) for name, table in content[TABLES].items()}
        agent = started(self.config, self.env, self.problem)
        try:
            agent.load_state_dict(laid_over(agent.state_dict(), content[STATE]))
        except (RuntimeError, ValueError, LookupError, TypeError, AttributeError) as error:
            raise UserError(
                f"{self.source}: the policy of other code than this credit's ({error}); compute the run anew with "
                "rerun=true, or use the credit that wrote it"
            ) from error
        self._agent = agent  # whose networks the policies look at
        return agent.policies()

    def named(self, name: str) -> Policy:
        """One of the policies.

        Raises:
            UserError: there is none of this name.
        """
        if name not in self.policies:
            known = ", ".join(self.policies)
            raise UserError(f"policy={name}: no such policy in {self.source}; it has {known}")
        return self.policies[name]


class KeptPolicy:
    """What one seed's policy does, in the environment's own spaces.

    Args:
        kept: the policy, with its environment. name: which, where a run has several (`greedy`, `averaged`).

    Example:
        >>> policy = credit.load("outputs/CartPole-v1/reference/default/seed-0").policy
        >>> observation, _ = gymnasium.make("CartPole-v1").reset(seed=0)
        >>> policy(observation)
        1
    """

    def __init__(self, kept: Kept, name: str = "behaviour") -> None:
        self._kept, self._name, self._policy = kept, name, kept.named(name)

    @torch.no_grad()
    def __call__(self, observation: Any, step: int = 0) -> Any:
        """The action for one observation: a whole number, or an array.

        Args:
            observation: as the environment gives it. step: in the episode, from 0 on, for policies that look at it.

        Raises:
            UserError: the observation is not of the environment's space.
        """
        kept = self._kept
        seen = inverse.require("observation", kept.problem.observation_space, kept.env.states_of(_batch(observation)))
        states = torch.as_tensor(seen if kept.problem.finite_states else np.asarray(seen, np.float32)).unsqueeze(0)
        action = self._policy.act(states, torch.full((1, 1), step))
        found = kept.env.recorded(action[0])[0].cpu().numpy()
        return found.item() if found.ndim == 0 else found

    def __repr__(self) -> str:
        """Which, of which run, in which spaces."""
        problem = self._kept.problem
        seen = f"{problem.states} states" if problem.finite_states else f"{problem.observations} numbers"
        done = f"{problem.actions} actions" if problem.finite_actions else f"{problem.actions} numbers"
        return f"KeptPolicy({self._kept.source.parent.name}, {self._name}: {seen} → {done})"


def _batch(observation: Any) -> Any:
    """One observation as those of one step."""
    if isinstance(observation, Mapping):
        return {key: _batch(part) for key, part in observation.items()}
    if isinstance(observation, tuple):
        return tuple(map(_batch, observation))
    try:
        return np.asarray(observation)[None]
    except ValueError:  # lists of unequal lengths, which no space has
        whole = np.empty(1, dtype=object)
        whole[0] = observation
        return whole


def read(folder: Path) -> dict[str, Any]:
    """The content of a run's `policy.pt`.

    Args:
        folder: of one seed.

    Raises:
        UserError: there is none, and why; or it is damaged.
    """
    file = folder / POLICY
    if not file.exists():
        raise UserError(f"{folder}: {_why_none(folder)}")
    content = checkpoint.load(file)
    if "config" not in content or not {TABLES, STATE} & {*content}:
        raise UserError(f"{file}: no policy of this version of credit; compute the run again with rerun=true")
    return content | {"config": translated(content["config"])}


def _why_none(folder: Path) -> str:
    if not folder.is_dir():
        return "there is no such folder; give that of a run, such as …/default/seed-0"
    if not (folder / "config.yaml").exists():
        return "no run lies here (a run's folder has a config.yaml); give one like …/default or …/default/seed-0"
    if not (folder / "DONE").exists():
        return "the run is not finished, and a policy is kept at its end; finish it by `credit resume`"
    if reason := read_json(folder / "summary.json").get("policy"):
        return f"no policy was kept: {reason}"
    return "the run is of an older version of credit, which kept no policy; compute it again with rerun=true"
