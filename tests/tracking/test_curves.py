"""The curves of a job: means over its runs, with intervals that can be."""

from __future__ import annotations

from credit.judges.exact import AverageReward
from credit.tracking.curves import Row, mean_rows


def test_intervals_of_rates_stay_between_0_and_1() -> None:
    journals = [[Row(7, {"policy/error": error, "regret/cumulative": error})] for error in (0.0, 0.1, 0.9)]
    (row,) = mean_rows(journals, rates=AverageReward.rates)
    assert row.values["interval/policy_error_low"] >= 0
    assert row.values["interval/policy_error_low"] < row.values["policy/error"] < 1
    assert row.values["interval/policy_error_high"] <= 1
    assert row.values["interval/regret_cumulative_low"] < 0  # a regret may
    (before,) = mean_rows(journals)  # of a session that does not say what its judge declares
    assert before.values["interval/policy_error_low"] < 0


def test_intervals_of_what_is_never_negative_end_at_0() -> None:
    journals = [[Row(7, {"reward/mse": error, "regret/cumulative": error})] for error in (0.0, 0.1, 0.9)]
    (row,) = mean_rows(journals)  # nobody has to declare it, so sessions of before have it, too
    assert row.values["interval/reward_mse_low"] == 0 < row.values["reward/mse"]
    assert row.values["interval/reward_mse_high"] == row.values["interval/regret_cumulative_high"]
    assert row.values["interval/regret_cumulative_low"] < 0
    for rows in journals:
        rows[0].values["regret/share"] = rows[0].values["regret/cumulative"]
    (episodic,) = mean_rows(journals)  # the regret of a value
    assert episodic.values["interval/regret_cumulative_low"] == episodic.values["interval/regret_share_low"] == 0
