"""How a run begins: started, with what it is given, and with the policy that it goes on from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from credit.core.errors import UserError
from credit.envs.playback import windows_of
from credit.envs.recorded import read
from credit.runs.kept import begin_with
from credit.trainer import Trainer


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
        trainer.give(*windows_of(logged, trainer.feedback, trainer.problem))
    except UserError as error:
        raise UserError(f"demonstrations_from: {error}") from None
    return {"logged": logged.digest}


def inherited(config: Mapping[str, Any], trainer: Trainer) -> None:
    """Make a started agent that of `policy_from`, where the configuration has it.

    Raises:
        UserError: it cannot be read, or does not fit.
    """
    if (policy := config.get("policy_from")) is not None:
        begin_with(policy, trainer.agent, trainer.problem)
