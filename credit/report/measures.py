"""What methods are compared by: metrics of the journal, with the words that tables and figures have for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from credit.core.errors import UserError, nearest
from credit.runs.intervals import GAP, POSITIVE, SHARE, Bounds


@dataclass(frozen=True)
class Measure:
    """A metric that a table shows: its column in the journal, its title, and which direction is better.

    `per` is another metric by which it is divided, the sum over seeds by the sum over seeds. A `rate` is a share, from
    0 to 1: intervals of it, and axes, stay there.
    """

    metric: str
    title: str
    axis: str
    lower_is_better: bool = True
    per: str = ""
    rate: bool = False
    positive: bool = False

    @property
    def bounds(self) -> Bounds | None:
        """Where means of it lie."""
        return SHARE if self.rate else POSITIVE if self.positive else None

    @property
    def gap(self) -> Bounds | None:
        """Where differences of two means of it lie."""
        return GAP if self.rate else None


# Of steps that are taken, which may earn more than g* does: it may lie below 0. That of a policy's value may not.
REGRET = Measure("regret/cumulative", "Final regret", "Cumulative regret")
OF_VALUE = replace(REGRET, positive=True)
RELATIVE = Measure(
    "regret/share", "Share of random's regret", "Regret as a share of that of random actions", positive=True
)
SUCCESS = Measure("eval/success", "Success rate", "Success rate", lower_is_better=False, rate=True)
RETURN = Measure("return/label", "Return", "Return", lower_is_better=False)
MSE = Measure("reward/mse", "Mixed reward MSE", "Mixed reward MSE", positive=True)
AVERAGED = replace(SUCCESS, metric="eval/success_averaged", title="Success rate, averaged actor")
WORTH = Measure("eval/return", "Return of the policy", "Return", lower_is_better=False)
AVERAGED_WORTH = Measure("eval/return_averaged", "Return, averaged actor", "Return", lower_is_better=False)
AUC = replace(SUCCESS, metric="eval/auc", title="AUC of success", axis="Mean success rate over the rounds")
AUC_OF_RETURN = Measure("eval/auc", "AUC of return", "Mean return over the rounds", lower_is_better=False)

CONTINUING = (
    REGRET,
    SUCCESS,
    Measure("regret/auc", "AUC regret", "Area under the regret curve"),
    Measure("policy/error", "Policy error", "Policy error", rate=True),
    MSE,
)
# Episodes have an exact regret of random actions, by which settings with other horizons and rewards can be read.
EPISODIC = (
    RELATIVE,
    OF_VALUE,
    Measure("return/policy", "Value of the policy", "Value of the executed policy", lower_is_better=False),
    MSE,
)
# Policies that are judged after every round, by success where there is such a thing, else by return. Success is
# bounded, and most reach it in the end: how soon (AUC) and how lastingly (lost) tell methods apart.
SUCCESS_ROUNDS = (
    replace(SUCCESS, metric="eval/final", title="Success in the last four rounds"),
    replace(SUCCESS, metric="eval/final_averaged", title="Last four, averaged actor"),
    AUC,
    replace(AUC, metric="eval/auc_averaged", title="AUC, averaged actor"),
    Measure("eval/lost", "Lost rounds", "Share of lost rounds", per="eval/learned", rate=True),
    Measure(
        "eval/lost_averaged", "Lost, averaged actor", "Share of lost rounds", per="eval/learned_averaged", rate=True
    ),
)
RETURN_ROUNDS = (
    Measure("eval/final", "Return in the last four rounds", "Return", lower_is_better=False),
    Measure("eval/final_averaged", "Last four, averaged actor", "Return", lower_is_better=False),
    AUC_OF_RETURN,
    Measure("eval/auc_averaged", "AUC, averaged actor", "Mean return over the rounds", lower_is_better=False),
)

EVERY = (AVERAGED, WORTH, AVERAGED_WORTH, RETURN, *RETURN_ROUNDS, *SUCCESS_ROUNDS, *CONTINUING, *EPISODIC)


def directed(key: str, metric: str) -> Measure:
    """A metric of a seed by itself whose direction is known, whether or not any run has it.

    Args:
        key: what it was asked for by. metric: its name.

    Raises:
        UserError: there is none of that name.
    """
    named = {measure.metric: measure for measure in EVERY if not measure.per}
    if metric not in named:
        raise UserError(
            f"{key}={metric}: there is none of that name whose direction is known; {nearest(metric, named)}"
        )
    return named[metric]


def choose_measures(known: Sequence[str], experiment: str, metric: str | None = None) -> tuple[Measure, ...]:
    """The columns of a table, the primary one first: the others only get a mean and an error.

    Args:
        known: metrics that at least one run has.
        experiment: for the message. metric: the one to rank by; None leaves it to what the runs have.

    Returns:
        Those that are known, in the order of columns.

    Raises:
        UserError: no run has a metric that methods can be compared by, or not the one that is asked for.
    """
    if metric is not None:
        first = known_measure("metric", metric, known)
        try:
            others = choose_measures(known, experiment)
        except UserError:
            others = ()
        return (first, *(measure for measure in others if measure.metric != metric))
    wanted: tuple[Measure, ...] = EPISODIC if RELATIVE.metric in known else CONTINUING
    if SUCCESS_ROUNDS[0].metric in known and REGRET.metric not in known:
        wanted = SUCCESS_ROUNDS if SUCCESS.metric in known else RETURN_ROUNDS
    measures = tuple(measure for measure in wanted if {measure.metric, measure.per or measure.metric} <= set(known))
    if wanted is CONTINUING and not {REGRET.metric, SUCCESS.metric} & set(known):
        measures = (*[measure for measure in (WORTH, RETURN) if measure.metric in known][:1], *measures)
    if not measures:
        names = ", ".join(measure.metric for measure in (*CONTINUING, RELATIVE, *RETURN_ROUNDS[::2], WORTH, RETURN))
        raise UserError(
            f"The runs of experiment={experiment} have none of the metrics that are compared "
            f"({names}); they have {', '.join(sorted(known)) or 'no metrics'}."
        )
    return measures


def known_measure(key: str, metric: str, known: Sequence[str]) -> Measure:
    """A metric that runs have and whose direction is known.

    Args:
        key: what it was asked for by. metric: its name. known: metrics that at least one run has.

    Raises:
        UserError: there is none of that name.
    """
    named = {measure.metric: measure for measure in EVERY}
    named |= {measure.metric: measure for measure in (EPISODIC if RELATIVE.metric in known else CONTINUING)}
    named |= {measure.metric: measure for measure in (SUCCESS_ROUNDS if SUCCESS.metric in known else RETURN_ROUNDS)}
    found = {name: measure for name, measure in named.items() if {name, measure.per or name} <= {*known}}
    if metric not in found:
        raise UserError(f"{key}={metric}: runs can be ranked by {', '.join(sorted(found)) or 'nothing'} here")
    return found[metric]


def choose_curves(known: Sequence[str], measures: Sequence[Measure]) -> tuple[Measure, ...]:
    """What is drawn over time: the regret where it is known, else the policies as they are judged.

    Args:
        known: metrics that at least one run has.
        measures: the columns of the table.
    """
    if REGRET.metric not in known:
        for judged in ((SUCCESS, AVERAGED), (WORTH, AVERAGED_WORTH)):
            if judged[0].metric in known:
                return tuple(measure for measure in judged if measure.metric in known)
    return (next((measure for measure in measures if measure.metric == REGRET.metric), measures[0]),)
