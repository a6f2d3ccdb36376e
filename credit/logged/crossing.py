"""Where states and actions are finite: a reference in which what an action is worth depends on the state.

Without that, the best action is the same in every state, and a policy from logs could not depend on the state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from credit.logged.models import Model
from credit.logged.panel import Column, Panel, Part, Roles
from credit.logged.registered import Registered

if TYPE_CHECKING:
    from credit.logged.recovered import Recovered

EACH = 10  # labelled windows at least for each column of a reference that nobody asked for


def finite(panel: Panel) -> bool:
    """Whether there are states and actions, all of them categories."""
    roles = panel.roles
    return bool(roles.states and roles.actions) and all(
        panel.columns[name].levels is not None for name in roles.features
    )


def crossed(panel: Panel) -> str:
    """(state + …) * (action + …), with names as a formula has them; "" where that is not for this table.

    There must be enough labelled windows for its columns, and rows of each pair of a state and an action: nothing tells
    what an action that was never taken in a state is worth there.
    """
    roles = panel.roles
    if not finite(panel):
        return ""
    states, actions = (
        [len(panel.columns[name].levels or ()) for name in names] for names in (roles.states, roles.actions)
    )
    columns = (1 + sum(states) - len(states)) * (1 + sum(actions) - len(actions))
    if columns * EACH > panel.windows.labelled.sum() or not _every_pair(panel):
        return ""
    return _product(roles)


def _product(roles: Roles) -> str:
    from credit.logged.asking import quoted

    sides = [" + ".join(map(quoted, names)) for names in (roles.states, roles.actions)]
    return " * ".join(f"({side})" if " + " in side else side for side in sides)


def _every_pair(panel: Panel) -> bool:
    """Whether each state was there with each action, in the first rows."""
    part, columns = next(panel.parts()), panel.columns
    return all(
        _seen(part, columns[state], columns[action]) for state in panel.roles.states for action in panel.roles.actions
    )


def _seen(part: Part, state: Column, action: Column) -> bool:
    first, second = (part.frame[one.name].cat.codes.to_numpy().astype(np.int64) for one in (state, action))
    sizes = len(state.levels or ()), len(action.levels or ())
    return len(np.unique(first * sizes[1] + second)) == sizes[0] * sizes[1]


def said(found: Recovered) -> str:
    """Whether there can be a policy, and whether it can depend on the state; "" where nobody would look for one."""
    roles, columns = found.panel.roles, found.panel.columns
    if not finite(found.panel):
        numbers = [name for name in roles.features if columns[name].levels is None]
        some = any(columns[name].levels is not None for name in roles.states)
        if some and roles.actions and not {*numbers} & {*roles.actions}:
            what = "is a number" if len(numbers) == 1 else "are numbers"
            return f"no policy is chosen: one is a table of states, and {', '.join(numbers)} {what}"
        return ""
    if any(isinstance(model, Registered) for model in found.models):
        return ""
    blocks = [block for model in found.models if isinstance(model, Model) for block in model.terms.blocks]
    if any({*block.features} & {*roles.states} and {*block.features} & {*roles.actions} for block in blocks):
        return f"states and actions are finite: what an action is worth may depend on the state ({_product(roles)})"
    return (
        "states and actions are finite, but no term has both: in these models what an action is worth is the same in "
        f"every state, and a policy is one of an additive model (reference.formula='1 + {_product(roles)}' tells more)"
    )
