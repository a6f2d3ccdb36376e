"""By which metric methods are ranked: the one that is asked for, in the direction that its judge declares."""

from __future__ import annotations

import pytest

from credit.core.errors import UserError
from credit.core.seams import Judge
from credit.judges.exact import AverageReward, Episodic
from credit.judges.rollouts import Rollouts
from credit.report.measures import (
    AVERAGED,
    CONTINUING,
    EPISODIC,
    RETURN_ROUNDS,
    SUCCESS,
    SUCCESS_ROUNDS,
    WORTH,
    choose_curves,
    choose_measures,
    known_measure,
)
from credit.runs.intervals import POSITIVE, bounds_of, is_rate

KNOWN = ("eval/auc", "eval/final", "eval/return", "eval/length", "return/label")


def test_the_metric_that_is_asked_for_comes_first() -> None:
    usual = choose_measures(KNOWN, "mine")
    found = choose_measures(KNOWN, "mine", "eval/return")
    assert found[0].metric == "eval/return"
    assert not found[0].lower_is_better
    assert found[1:] == usual
    assert choose_measures(KNOWN, "mine", "eval/auc")[0].title == "AUC of return"
    assert choose_measures((*KNOWN, "eval/success"), "mine", "eval/auc")[0].title == "AUC of success"
    with pytest.raises(UserError, match=r"metric=eval/nothing: runs can be ranked by eval/auc, eval/final, .*"):
        choose_measures(KNOWN, "mine", "eval/nothing")


def test_what_a_judge_declares_a_rate_is_drawn_and_bounded_as_one() -> None:
    declared = {**AverageReward.rates, **Rollouts.rates}
    every = {*CONTINUING, *EPISODIC, *SUCCESS_ROUNDS, SUCCESS, AVERAGED, WORTH}
    for measure in every:
        if not measure.per:  # a share of rounds, of which the judge gives both counts
            assert is_rate(measure.metric, declared, ["eval/success"]) is measure.rate, measure.metric
    assert not any(measure.rate for measure in RETURN_ROUNDS)


def test_the_report_and_trackers_bound_means_alike() -> None:
    declared = {**AverageReward.rates, **Rollouts.rates}
    steps = ["eval/success", "regret/cumulative"]
    for known, measures in ((steps, {*CONTINUING, *SUCCESS_ROUNDS}), ([*steps, "regret/share"], {*EPISODIC})):
        for measure in measures:
            if not measure.per:
                assert bounds_of(measure.metric, declared, known) == measure.bounds, measure.metric


def test_a_regret_is_never_negative_where_it_is_that_of_a_value() -> None:
    steps, values = ["regret/cumulative", "reward/mse"], ["regret/cumulative", "regret/share", "reward/mse"]
    for known, bounds in ((steps, None), (values, POSITIVE)):
        measures = {measure.metric: measure for measure in choose_measures(known, "mine")}
        (drawn,) = choose_curves(known, tuple(measures.values()))
        asked = known_measure("metric", "regret/cumulative", known)
        assert drawn.metric == "regret/cumulative"
        assert drawn.bounds == asked.bounds == bounds
        assert measures["reward/mse"].bounds == POSITIVE
    assert measures["regret/share"].bounds == POSITIVE


@pytest.mark.parametrize("judge", [AverageReward, Episodic, Rollouts])
def test_a_table_ranks_in_the_direction_that_the_judge_declares(judge: type[Judge]) -> None:
    found = choose_measures([judge.metric], "mine", judge.metric)
    assert found[0].lower_is_better is not judge.higher_is_better
