"""What each of TorchRL's losses needs to be an agent: a head, networks and settings. A new loss is a new recipe."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.modules import ValueOperator
from torchrl.objectives import ClipPPOLoss, DiscreteSACLoss, TD3Loss
from torchrl.objectives.utils import ValueEstimators

from credit.agents.torchrl.heads import Bounded, Categories, Head, Squashed
from credit.core.capabilities import SAYS
from credit.core.component import Kind
from credit.core.errors import UserError
from credit.core.problem import Problem

if TYPE_CHECKING:
    from credit.agents.torchrl.agent import TorchRL

Make = Callable[[int, int], nn.Module]  # inputs, outputs → a fresh network


class Joined(nn.Module):
    """A network on several tensors side by side.

    Args:
        network: on [..., sum of their sizes].
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, *parts: Tensor) -> Tensor:
        """What it makes of parts [..., size]."""
        values: Tensor = self.network(torch.cat(parts, -1))
        return values


class Recipe(ABC):
    """How a loss becomes an agent.

    Attributes:
        actions: that it takes. newest: whether it learns from the newest round alone, and not from a replay.
        critic: the method of the loss for its critics alone, used between two updates of the actor.
        reports: what is told of an update: our name → TorchRL's.
    """

    actions: ClassVar[Kind]
    newest: ClassVar[bool] = False
    critic: ClassVar[str] = ""
    reports: ClassVar[Mapping[str, str]]

    @abstractmethod
    def head(self, agent: TorchRL, problem: Problem) -> Head:
        """What the actor's outputs mean."""

    @abstractmethod
    def loss(self, agent: TorchRL, actor: Any, make: Make, observations: int, actions: int) -> Any:
        """The loss module.

        Args:
            agent: its settings. actor: TorchRL's actor. make: networks for critics. observations: numbers that networks
                see of a state. actions: A.
        """


class PPO(Recipe):
    """Clipped proximal policy optimization: an actor and a state value, advantages by GAE."""

    actions = "any"
    newest = True
    reports: ClassVar = {
        "actor": "loss_objective",
        "critic": "loss_critic",
        "entropy": "entropy",
        "clipped": "clip_fraction",
        "kl": "kl_approx",
    }

    def head(self, agent: TorchRL, problem: Problem) -> Head:
        """A distribution over actions of either kind."""
        return (Categories if problem.finite_actions else Squashed)(problem.actions)

    def loss(self, agent: TorchRL, actor: Any, make: Make, observations: int, actions: int) -> Any:
        """`ClipPPOLoss`; advantages are standardized in each minibatch."""
        module = ClipPPOLoss(
            actor,
            ValueOperator(make(observations, 1), in_keys=["observation"]),
            clip_epsilon=agent.clip,
            entropy_coeff=agent.entropy,
            critic_coeff=1.0,
            loss_critic_type=agent.critic_loss,
            normalize_advantage=True,
            log_explained_variance=False,
        )
        module.make_value_estimator(ValueEstimators.GAE, gamma=agent.discount, lmbda=agent.gae_lambda)
        return module


class TD3(Recipe):
    """Twin delayed deterministic policy gradient."""

    actions = "vector"
    critic = "value_loss"
    reports: ClassVar = {"actor": "loss_actor", "critic": "loss_qvalue", "q": "target_value"}

    def head(self, agent: TorchRL, problem: Problem) -> Head:
        """One action, with noise where it explores."""
        return Bounded(problem.actions, agent.noise)

    def loss(self, agent: TorchRL, actor: Any, make: Make, observations: int, actions: int) -> Any:
        """`TD3Loss` with two critics."""
        module = TD3Loss(
            actor,
            ValueOperator(Joined(make(observations + actions, 1)), in_keys=["observation", "action"]),
            bounds=(-1.0, 1.0),
            policy_noise=agent.target_noise,
            noise_clip=agent.target_noise_clip,
            loss_function=agent.critic_loss,
        )
        module.make_value_estimator(ValueEstimators.TD0, gamma=agent.discount)
        return module


class DiscreteSAC(Recipe):
    """Soft actor-critic over finite actions."""

    actions = "finite"
    critic = "qvalue_loss"
    reports: ClassVar = {
        "actor": "loss_actor",
        "critic": "loss_qvalue",
        "alpha": "loss_alpha",
        "entropy": "entropy",
        "temperature": "alpha",
    }

    def head(self, agent: TorchRL, problem: Problem) -> Head:
        """Probabilities."""
        return Categories(problem.actions)

    def loss(self, agent: TorchRL, actor: Any, make: Make, observations: int, actions: int) -> Any:
        """`DiscreteSACLoss` with two critics; the temperature is adapted."""
        module = DiscreteSACLoss(
            actor,
            TensorDictModule(make(observations, actions), in_keys=["observation"], out_keys=["action_value"]),
            action_space="categorical",
            num_actions=actions,
            alpha_init=agent.temperature,
            target_entropy_weight=agent.target_entropy,
            loss_function=agent.critic_loss,
        )
        module.make_value_estimator(ValueEstimators.TD0, gamma=agent.discount)
        return module


RECIPES: dict[str, Recipe] = {"ppo": PPO(), "td3": TD3(), "discrete_sac": DiscreteSAC()}


def recipe(loss: str, problem: Problem) -> Recipe:
    """The recipe of a loss.

    Raises:
        UserError: it does not take the actions of the problem.
    """
    given: Kind = "finite" if problem.finite_actions else "vector"
    chosen = RECIPES[loss]
    if chosen.actions in ("any", given):
        return chosen
    others = [name for name, each in RECIPES.items() if each.actions in ("any", given)]
    raise UserError(
        f"agent.loss={loss!r}: it needs actions that are {SAYS[chosen.actions]}, and here they are {SAYS[given]}; take "
        f"one that goes with those: {', '.join(f'agent.loss={name}' for name in others)}"
    )
