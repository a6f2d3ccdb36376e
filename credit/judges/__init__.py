"""What says how good a policy is: exact where P and r are known, by rollouts everywhere."""

from __future__ import annotations

from credit.core.problem import Problem
from credit.core.seams import Environment, Feedback, Judge
from credit.core.truth import ContinuingTruth, EpisodicTruth
from credit.judges.exact import AverageReward, FiniteHorizon
from credit.judges.rollouts import Rollouts


def judge(env: Environment, feedback: Feedback, problem: Problem) -> Judge:
    """The judge of an environment, for the objective that the feedback shows.

    Raises:
        UserError: nobody can judge that objective there.
    """
    truth = env.truth(feedback.objective, problem)
    if isinstance(truth, ContinuingTruth):
        return AverageReward(problem, truth)
    if isinstance(truth, EpisodicTruth):
        return FiniteHorizon(problem, truth)
    return Rollouts(problem, env)
