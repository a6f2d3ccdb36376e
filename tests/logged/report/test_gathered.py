"""What is added up over time, groups and actions, against pandas; and the same of large tables."""

from __future__ import annotations

import numpy as np
import pytest

from credit.logged.periods import periods
from credit.logged.report.gathered import gathered
from tests.logged.fits.test_units import windows
from tests.logged.test_recovering import found, table


def test_windows_that_begin_together_are_one_period_and_there_are_not_more_than_asked_for() -> None:
    assert [*periods(windows(2, 5))] == [0, 1, 2, 3, 4] * 2
    assert [*periods(windows(1, 5), most=3)] == [0, 0, 1, 1, 2]
    assert len(set(periods(windows(3, 1000), most=160))) <= 160


@pytest.mark.parametrize("most", [pytest.param(160, marks=pytest.mark.thorough), 7])
def test_means_over_time_groups_and_actions_are_those_of_the_steps(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    import credit.logged.effects
    import credit.logged.report.gathered as module

    for one in (module, credit.logged.effects):
        monkeypatch.setattr(one, "periods", lambda windows: periods(windows, most))
    frame = table(groups=3)
    one = found(frame, draws=5)
    data, steps = gathered(one), one.steps
    width = -(-40 // most)
    when = frame["w"] // width
    for name in ("credit", "low", "high", "disagreement"):
        column = steps[name if name in steps else f"credit_{name}"]
        np.testing.assert_allclose(getattr(data, name), column.groupby(when).mean(), rtol=1e-9)
    np.testing.assert_allclose(data.each[1], steps["credit_actions"].groupby(when).mean(), rtol=1e-9)
    assert [*data.when] == [str(5 * width * period) for period in range(len(data.when))]
    by_window = one.windows.groupby(one.windows["w"] // width)
    np.testing.assert_allclose(data.label, by_window["label"].mean(), rtol=1e-9)
    np.testing.assert_allclose(data.held_out[-1], by_window["held_out"].mean(), rtol=1e-9)
    by_group = steps.groupby(frame["g"])
    assert [share.name for share in data.groups] == ["g0", "g1", "g2"]
    np.testing.assert_allclose([share.credit for share in data.groups], by_group["credit"].mean(), rtol=1e-9)
    np.testing.assert_allclose([share.disagreement for share in data.groups], by_group["disagreement"].mean())
    apart = (steps["credit_reference"] - steps["credit_actions"]).abs()
    np.testing.assert_allclose([share.apart for share in data.groups], apart.groupby(frame["g"]).mean())
    assert [*data.top["row"]] == [*apart.sort_values(ascending=False).index[:10]]
    assert [*data.top["t"].astype(int)] == [*frame["t"][data.top["row"]]]
    assert sum(share.rows for share in data.actions) == len(frame)
    total = one.effects_over_time["effect"].sum()
    np.testing.assert_allclose(total, one.effects.set_index("model").loc["mixture", "total"], rtol=1e-9)
    in_period = one.effects_over_time.set_index("period")["effect"]
    by_reference = 3 * frame["x"].groupby(when).sum()
    np.testing.assert_allclose(in_period, by_reference, rtol=0.1)
