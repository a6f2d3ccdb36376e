"""The seams: every component that YAML can name is one of these.

Constructors take hyper-parameters and other components, and store them. `start(problem)` makes the state of R
replicas; nothing heavy happens before it. Class attributes say what a component needs, so that the check can tell
whether parts fit together without building any of them.
"""

from __future__ import annotations

from credit.core.seams.agents import Agent, Transition, TransitionTable
from credit.core.seams.recovery import (
    Bonus,
    CreditAssigner,
    Encoder,
    FeatureMap,
    Likelihood,
    Look,
    Mixer,
    Places,
    Relabel,
    RewardModel,
    Scaler,
    Uncertainty,
)
from credit.core.seams.worlds import Act, Environment, Evaluated, Evaluation, Feedback, Judge, Objective, Transitions

__all__ = [
    "Act",
    "Agent",
    "Bonus",
    "CreditAssigner",
    "Encoder",
    "Environment",
    "Evaluated",
    "Evaluation",
    "FeatureMap",
    "Feedback",
    "Judge",
    "Likelihood",
    "Look",
    "Mixer",
    "Objective",
    "Places",
    "Relabel",
    "RewardModel",
    "Scaler",
    "Transition",
    "TransitionTable",
    "Transitions",
    "Uncertainty",
]
