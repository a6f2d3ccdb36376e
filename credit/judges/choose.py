"""Which judge an environment and a feedback have."""

from __future__ import annotations

from collections.abc import Callable

from credit.core.errors import UserError
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
        UserError: the feedback does not say its objective; or the environment is exact, and does not know its truth.
    """
    objective = objective_of(feedback)
    truth = env.truth(objective, problem.horizon)
    if truth is None:
        return Rollouts(problem, evaluation(env.evaluation_episodes), objective == "success")
    return AverageReward(problem, truth) if isinstance(truth, ContinuingTruth) else Episodic(problem, truth)


def objective_of(feedback: Feedback) -> str:
    """What a feedback asks for: a judge that took a sum for granted would judge another problem.

    Raises:
        UserError: it does not say so.
    """
    said = getattr(feedback, "objective", None)
    if isinstance(said, str) and said:
        return said
    name, additive = type(feedback).__name__, getattr(feedback, "additive", None)
    what = f"{name} has objective = {said!r}, which is no name"
    if said is None:
        what = f"{name} does not say its objective"
    if said is None and additive is not None:
        instead = "sum" if additive else "last"
        what = f"{name} has additive = {additive}, which older versions read: declare objective = {instead!r} instead"
    raise UserError(
        f"feedback: {what}; a judge must know what policies are to be judged by. A class says objective = 'sum' (all "
        "rewards of a window together), 'last' (its last one), 'success' (whether one is positive), or, where nobody "
        "knows P and r, a name of its own"
    )
