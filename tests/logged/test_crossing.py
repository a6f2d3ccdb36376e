"""The default reference of finite states and actions can tell that the best action depends on the state."""

from __future__ import annotations

from typing import Any

import pandas as pd
import pytest

import credit
from credit.logged.result import LoggedCredit
from tests.logged.test_policies import logs
from tests.logged.test_recovering import found, table

PAIRS = "states and actions are finite: what an action is worth may depend on the state (s * a)"


def default(frame: pd.DataFrame, **words: Any) -> LoggedCredit:
    return credit.recover(
        frame, **{"window": "w", "label": "y", "actions": ["a"], "states": ["s"], "draws": 20, **words}
    )


def formula(one: LoggedCredit) -> Any:
    return one.found.models[0].terms.formula  # type: ignore[union-attr]


def test_a_policy_by_default_may_depend_on_the_state() -> None:
    one = default(logs(400, 2))
    assert formula(one) == "1 + s * a"
    assert PAIRS in one.said
    assert one.policies is not None
    assert one.policies.table.set_index("s")["a"].to_dict() == {"p": "b", "q": "a"}


def test_several_states_meet_every_action() -> None:
    frame = logs(100, 2)
    one = default(frame.assign(b=frame["a"].iloc[::-1].to_numpy()), states=["s", "b"])
    assert formula(one) == "1 + (s + b) * a"


def few(frame: pd.DataFrame) -> pd.DataFrame:
    return frame[frame["w"] < 39]


def unseen(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(a=frame["a"].where(frame["s"] == "p", "b"))


@pytest.mark.parametrize("cut", [few, unseen])
def test_an_additive_model_is_said_to_be_one(cut: Any) -> None:
    one = default(cut(logs(100, 2)))
    assert formula(one) is None
    (said,) = [sentence for sentence in one.said if "additive" in sentence]
    assert said.endswith("(reference.formula='1 + s * a' tells more)")


def test_numbers_have_no_pairs() -> None:
    assert not any("finite" in sentence or "policy" in sentence for sentence in found(table()).said)
    frame = logs(60, 2).assign(z=range(120))
    assert "no policy is chosen: one is a table of states, and z is a number" in default(frame, states=["s", "z"]).said
