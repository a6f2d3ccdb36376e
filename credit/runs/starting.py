"""How a run begins: started, with what it is given, and with the policy that it goes on from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from credit.core.errors import UserError
from credit.envs.playback import Found, alone, for_all
from credit.envs.recorded import read
from credit.runs.kept import begin_with
from credit.trainer import Trainer

_made: dict[tuple[str, str, str], Found] = {}  # the last that were made in this process


def given(config: Mapping[str, Any], trainer: Trainer) -> dict[str, str]:
    """Give a started trainer the steps of `demonstrations_from`, where the configuration has it.

    Returns:
        What was given, and its digest.

    Raises:
        UserError: they cannot be read, or do not fit.
    """
    if (source := config.get("demonstrations_from")) is None:
        return {}
    try:
        logged = read(source, trainer.env, trainer.problem)
        # the check of a run makes the windows, the run learns from them: steps are played again one by one
        what = (digest := logged.digest, repr(config["feedback"]), repr(replace(trainer.problem, seeds=())))
        if what not in _made:
            _made.clear()
            _made[what] = alone(logged, trainer.feedback, trainer.problem)
        trainer.give(*for_all(_made[what], trainer.problem.replicas))
    except UserError as error:
        raise UserError(f"demonstrations_from: {error}") from None
    return {"logged": digest}


def inherited(config: Mapping[str, Any], trainer: Trainer) -> None:
    """Make a started agent that of `policy_from`, where the configuration has it.

    Raises:
        UserError: it cannot be read, or does not fit.
    """
    if (policy := config.get("policy_from")) is not None:
        begin_with(policy, trainer.agent, trainer.problem)
