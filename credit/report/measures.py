"""What methods are compared by: metrics of the journal, with the words that tables and figures have for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from credit.errors import UserError


@dataclass(frozen=True)
class Measure:
    """A metric that a table shows: its column in the journal, its title, and which direction is better."""

    metric: str
    title: str
    axis: str
    lower_is_better: bool = True


REGRET = Measure("regret/cumulative", "Final regret", "Cumulative regret")
SHARE = Measure("regret/share", "Share of random's regret", "Regret as a share of that of random actions")
SUCCESS = Measure("eval/success", "Success rate", "Success rate", lower_is_better=False)
RETURN = Measure("return/label", "Return", "Return", lower_is_better=False)
MSE = Measure("reward/mse", "Mixed reward MSE", "Mixed reward MSE")

CONTINUING = (
    REGRET,
    SUCCESS,
    Measure("regret/auc", "AUC regret", "Area under the regret curve"),
    Measure("policy/error", "Policy error", "Policy error"),
    MSE,
)
# Episodes have an exact regret of random actions, by which settings with other horizons and rewards can be read.
EPISODIC = (
    SHARE,
    REGRET,
    Measure("return/policy", "Value of the policy", "Value of the executed policy", lower_is_better=False),
    MSE,
)


def choose_measures(known: Sequence[str], experiment: str) -> tuple[Measure, ...]:
    """The columns of a table, the primary one first: the others only get a mean and an error.

    Args:
        known: metrics that at least one run has.
        experiment: for the message.

    Raises:
        UserError: no run has a metric that methods can be compared by.
    """
    wanted = EPISODIC if SHARE.metric in known else CONTINUING
    measures = tuple(measure for measure in wanted if measure.metric in known)
    if not {REGRET.metric, SUCCESS.metric, SHARE.metric} & set(known) and RETURN.metric in known:
        measures = (RETURN, *measures)
    if not measures:
        names = ", ".join(measure.metric for measure in (*CONTINUING, SHARE, RETURN))
        raise UserError(
            f"The runs of experiment={experiment} have none of the metrics that are compared "
            f"({names}); they have {', '.join(sorted(known)) or 'no metrics'}."
        )
    return measures
