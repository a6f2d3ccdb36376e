"""Which judge an environment and a feedback have."""

from __future__ import annotations

from collections.abc import Callable

from credit.core.problem import Problem
from credit.core.seams import Environment, Evaluation, Feedback, Judge
from credit.core.truth import ContinuingTruth
from credit.judges.exact import AverageReward, Episodic
from credit.judges.rollouts import Rollouts


def judge(env: Environment, feedback: Feedback, problem: Problem, evaluation: Callable[[int], Evaluation]) -> Judge:
    """Exact where the environment knows the truth of what the label shows, else by rollouts.

    Args:
        env, feedback: started. problem: sizes.
        evaluation: makes episodes of their own, of so many of each replica; asked only where there are rollouts.

    Raises:
        UserError: the environment is exact, and does not know the truth of this feedback's objective.
    """
    truth = env.truth(feedback.objective, problem.window)
    if truth is None:
        return Rollouts(problem, evaluation(env.evaluation_episodes), feedback.objective == "success")
    return AverageReward(problem, truth) if isinstance(truth, ContinuingTruth) else Episodic(problem, truth)
