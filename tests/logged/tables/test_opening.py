from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from credit.core.errors import UserError
from credit.logged.panel import Panel
from credit.logged.tables import sources
from credit.logged.tables.opening import opened

from .tables import decisions, marketing

ROLES = {"window": "week", "label": "sales", "time": "day", "group": "region", "actions": ["tv", "radio"],
         "states": ["temperature", "sky"]}  # fmt: skip


def whole(panel: Panel) -> pd.DataFrame:
    """All rows, with the number of their window."""
    return pd.concat([part.frame.assign(number=part.window) for part in panel.parts()])


def naive(frame: pd.DataFrame) -> pd.DataFrame:
    """Windows by pandas' own grouping."""
    ordered = frame.sort_values(["region", "day"], kind="stable")
    return ordered.groupby(["region", "week"], sort=False).agg(
        steps=("day", "size"), label=("sales", "max"), begins=("day", "min"), tv=("tv", "sum")
    )


def same(one: Panel, other: Panel) -> None:
    assert one.roles == other.roles
    assert (one.windows.key == other.windows.key).all()
    for name in ("group", "time", "steps", "label"):
        np.testing.assert_array_equal(getattr(one.windows, name), getattr(other.windows, name))
    for name in one.columns:
        mine, theirs = one.columns[name], other.columns[name]
        assert (mine.levels, mine.frequent, mine.least, mine.most) == (
            theirs.levels,
            theirs.frequent,
            theirs.least,
            theirs.most,
        )
        np.testing.assert_allclose([mine.mean, mine.deviation], [theirs.mean, theirs.deviation], rtol=1e-12)
        np.testing.assert_allclose(mine.quantiles, theirs.quantiles, rtol=1e-12)
    features = [*one.columns]
    mine_rows, their_rows = whole(one), whole(other)
    assert (mine_rows.index == their_rows.index).all()
    pd.testing.assert_frame_equal(mine_rows[[*features, "number"]], their_rows[[*features, "number"]])


@pytest.mark.parametrize("shuffled", [False, True])
def test_windows_and_sums_are_those_of_a_grouping(shuffled: bool) -> None:
    frame = marketing().sample(frac=1, random_state=3) if shuffled else marketing()
    panel, expected = opened(frame, ROLES), naive(frame)
    windows = panel.windows
    assert windows.groups == ("r0", "r1", "r2")
    assert [(windows.groups[g], i) for g, i in zip(windows.group, windows.id, strict=True)] == [*expected.index]
    np.testing.assert_array_equal(windows.steps, expected.steps)
    np.testing.assert_allclose(windows.label, expected.label)
    np.testing.assert_array_equal(windows.time, [0, 1, 2, 3] * 3)
    (part,) = panel.parts()
    np.testing.assert_allclose(part.sums(part.frame.tv.to_numpy()), expected.tv)
    np.testing.assert_array_equal(part.frame.tv, frame.tv.to_numpy()[part.frame.index])
    assert panel.rows == len(frame) == len(part)
    assert any("sorted by region, day" in sentence for sentence in panel.said) == shuffled


def test_columns_say_what_all_rows_say() -> None:
    frame = marketing()
    panel = opened(frame, {**ROLES, "stock": ["temperature"]})
    column = panel.columns["temperature"]
    assert column.stock
    np.testing.assert_allclose(
        [column.mean, column.deviation], [frame.temperature.mean(), frame.temperature.std(ddof=0)]
    )
    np.testing.assert_allclose(column.quantiles, np.quantile(frame.temperature, np.linspace(0, 1, 21)))
    sky = panel.columns["sky"]
    assert sky.levels == ("clear", "cloudy", "rain")
    assert sky.frequent == frame.sky.mode()[0]


@pytest.mark.parametrize("how", ["csv", "parquet", "shards", "hive", "converted", "streamed", "categories"])
def test_the_same_table_whatever_it_lies_in(how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame, memory = marketing(days=35), 2**29
    expected = opened(frame, ROLES)
    if how == "streamed":  # windows and groups that go on from one chunk to the next
        monkeypatch.setattr(sources, "CHUNK", 10)
    path: Any = tmp_path / "data.parquet"
    if how in ("csv", "converted"):
        path = tmp_path / "data.csv"
        frame.to_csv(path, index=False)
        memory = 100 if how == "converted" else memory
    elif how == "shards":
        for i in range(4):
            frame.iloc[i * 30 : (i + 1) * 30].to_parquet(tmp_path / f"part-{i}.parquet", index=False)
        path, memory = str(tmp_path / "part-*.parquet"), 100
    elif how == "hive":
        for region, rows in frame.groupby("region"):
            (tmp_path / f"region={region}").mkdir()
            rows.drop(columns="region").to_parquet(tmp_path / f"region={region}" / "x.parquet", index=False)
        path, memory = tmp_path, 100
    else:
        frame = frame.astype({"sky": "category"}) if how == "categories" else frame
        frame.to_parquet(path, index=False, row_group_size=17)
        memory = 100
    panel = opened(path, ROLES, memory=memory)
    same(panel, expected)


def test_parts_end_with_windows_and_groups_go_on(tmp_path: Path) -> None:
    frame = marketing(days=33)  # the last week is short
    frame.to_parquet(tmp_path / "data.parquet", index=False)
    panel: Any = opened(tmp_path / "data.parquet", ROLES, memory=100)
    parts = [*panel.parts(15)]
    assert len(parts) > 4
    last = -1
    for part in parts:
        assert part.window[0] == last + 1
        counts = np.bincount(part.window - part.window[0])
        np.testing.assert_array_equal(counts, panel.windows.steps[part.window[0] : part.window[-1] + 1])
        assert part.continues == (last >= 0 and panel.windows.group[last] == panel.windows.group[last + 1])
        last = part.window[-1]
    assert last + 1 == len(panel.windows)
    np.testing.assert_array_equal(np.concatenate([part.frame.tv for part in parts]), frame.tv)


@pytest.mark.parametrize("duckdb", [True, False])
def test_files_out_of_order_are_sorted(duckdb: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "work"))
    (tmp_path / "work").mkdir()
    if duckdb:
        pytest.importorskip("duckdb")
    else:
        monkeypatch.setitem(sys.modules, "duckdb", None)
    frame = marketing().sample(frac=1, random_state=5)
    frame.to_parquet(tmp_path / "data.parquet", index=False)
    panel = opened(tmp_path / "data.parquet", ROLES, memory=3000)
    same(panel, opened(frame, ROLES))
    assert len([*(tmp_path / "work").iterdir()]) == duckdb
    del panel
    assert not [*(tmp_path / "work").iterdir()]


def test_too_many_rows_out_of_order_need_duckdb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "duckdb", None)
    marketing().sample(frac=1, random_state=5).to_parquet(tmp_path / "data.parquet", index=False)
    with pytest.raises(UserError, match=r"order of region and day.*pip install 'credit-rl\[duckdb\]'"):
        opened(tmp_path / "data.parquet", ROLES, memory=100)


@pytest.mark.parametrize("how", ["last row", "second table", "second table without groups"])
def test_labels_may_lie_elsewhere(how: str, tmp_path: Path) -> None:
    frame = marketing(1 if "without" in how else 3)
    expected, given = opened(frame, ROLES), dict(ROLES)
    if how == "last row":
        last = frame.groupby(["region", "week"]).cumcount(ascending=False) == 0
        frame["sales"] = frame.sales.where(last)
    else:
        keys = ["week"] if "without" in how else ["region", "week"]
        weeks = frame.groupby(keys).sales.max().reset_index().sample(frac=1, random_state=0)
        weeks.to_csv(tmp_path / "weeks.csv", index=False)
        frame, given["labels"] = frame.drop(columns="sales"), str(tmp_path / "weeks.csv")
    panel = opened(frame, given)
    np.testing.assert_allclose(panel.windows.label, expected.windows.label)
    assert (panel.windows.key == expected.windows.key).all()


def test_labels_may_be_missing() -> None:
    frame = marketing()
    frame.loc[frame.week == 2, "sales"] = np.nan
    windows = opened(frame, ROLES).windows
    np.testing.assert_array_equal(windows.labelled, [True, True, False, True] * 3)


def test_missing_values_are_dropped_or_filled() -> None:
    frame = marketing()
    frame.loc[[3, 4], "tv"] = np.nan
    frame.loc[[4, 30], "sky"] = None
    frame.loc[7:13, "radio"] = np.nan  # a whole week
    with pytest.raises(UserError, match=r"tv 2, radio 7, sky 2; the first is tv of row 3"):
        opened(frame, ROLES)
    dropped = opened(frame, {**ROLES, "missing": "drop"})
    assert dropped.rows == len(frame) - 10
    assert len(dropped.windows) == 11
    assert dropped.windows.steps.tolist()[:3] == [5, 7, 7]
    (part,) = dropped.parts()
    assert not {3, 4, 30, 7, 13} & {*part.frame.index}
    assert part.window.max() == 10
    assert any("10 rows with missing values" in sentence for sentence in dropped.said)
    assert any("1 windows have no rows left" in sentence for sentence in dropped.said)
    filled = opened(frame, {**ROLES, "missing": "mean"})
    (part,) = filled.parts()
    assert part.frame.tv[3] == pytest.approx(frame.tv.mean())
    assert part.frame.sky[30] == filled.columns["sky"].frequent
    assert filled.rows == len(frame)


def test_dates_become_what_is_named() -> None:
    frame = marketing()
    panel = opened(frame, {**ROLES, "calendar": ["weekday", "month", "weekend"]})
    assert panel.roles.states == ("temperature", "sky", "weekday", "month", "weekend")
    assert panel.columns["weekday"].levels == ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
    assert panel.columns["month"].levels == ("Jan",)
    (part,) = panel.parts()
    assert part.frame.weekday.tolist() == frame.day.dt.strftime("%a").tolist()
    assert part.frame.weekend.tolist() == (frame.day.dt.weekday >= 5).astype(float).tolist()


def test_an_index_with_names_is_columns() -> None:
    frame = marketing()
    same(opened(frame.set_index(["region", "day"]), ROLES), opened(frame, ROLES))


TYPES: dict[str, Any] = {
    "nullable": lambda f: f.convert_dtypes(),
    "of arrow": lambda f: f.convert_dtypes(dtype_backend="pyarrow"),
    "in a time zone": lambda f: f.assign(day=f.day.dt.tz_localize("Europe/Berlin")),
    "of python": lambda f: f.assign(day=f.day.dt.date),
    "periods": lambda f: f.assign(day=f.day.dt.to_period("D")),
    "text": lambda f: f.assign(day=f.day.dt.strftime("%d.%m.%Y")),
    "categories": lambda f: f.astype({"region": "category", "week": "category", "sky": "category"}),
    "fractions": lambda f: f.assign(week=f.week.astype(float)),
}


@pytest.mark.parametrize("name", TYPES)
def test_types_of_columns_change_nothing(name: str) -> None:
    frame = marketing().sample(frac=1, random_state=1)
    same(opened(TYPES[name](frame), ROLES), opened(frame, ROLES))


def test_a_table_without_time_keeps_its_order() -> None:
    frame = pd.DataFrame(
        {"episode": np.repeat([7, 3, 9], [2, 3, 1]), "a": [0.0, 1, 1, 0, 1, 1], "y": [1, 1, 4, 4, 4, 2]}
    )
    panel = opened(frame, {"window": "episode", "label": "y"})
    assert panel.windows.id.tolist() == [7, 3, 9]
    assert panel.windows.time.tolist() == [0, 1, 2]
    assert panel.windows.steps.tolist() == [2, 3, 1]
    assert panel.roles.time is None
    assert panel.roles.actions == ("a",)


def _but(**columns: Any) -> pd.DataFrame:
    frame = marketing()
    for name, change in columns.items():
        frame[name] = change(frame) if callable(change) else change
    return frame


def _set(name: str, row: int, value: Any) -> pd.DataFrame:
    frame = marketing()
    frame[name] = frame[name].astype(object) if isinstance(value, str) else frame[name]
    frame.loc[row, name] = value
    return frame


BAD: dict[str, tuple[Any, dict[str, Any], str]] = {
    "no such window": (marketing(), {"window": "wek"}, r"data\.window=wek: .*did you mean 'week'"),
    "no such action": (marketing(), {"actions": ["tvv"]}, r"data\.actions names 'tvv': .*did you mean 'tv'"),
    "labels differ": (_set("sales", 3, 5.0), {}, r"sales is .* in rows of one window, week 0 of region r0, .*row 0"),
    "split": (_but(week=lambda f: f.week.replace({3: 1})), {}, r"week 1 of region r0 do not follow .*row 7, .*row 21"),
    "split, no group": (marketing(), {"group": False, "time": False}, r"week 0 do not follow .*data\.group"),
    "split, called window": (
        marketing().rename(columns={"week": "window"}), {"group": False, "time": False, "window": "window"},
        r"the rows of window 0 do not follow",
    ),
    "called row": (
        marketing().rename(columns={"day": "row"}), {"time": "row"}, r"the column 'row' \(data\.time\) .*\(in steps\)",
    ),
    "called steps": (
        marketing().rename(columns={"week": "steps"}), {"window": "steps"}, r"'steps' .*\(in windows\)",
    ),
    "called credit": (
        marketing().rename(columns={"region": "credit"}), {"group": "credit"}, r"'credit' \(data\.group\)",
    ),
    "one window": (_but(week=0, region="r0", day=lambda f: np.arange(len(f)), sales=1.0), {}, r"one window only"),
    "all equal": (_but(sales=2.5), {}, r"sales is 2\.5 in all windows"),
    "no labels": (_but(sales=np.nan), {}, r"sales is empty in all 12 windows"),
    "label a feature": (marketing(), {"states": ["sales"]}, r"sales is the label, and among the features"),
    "window a feature": (marketing(), {"states": ["week"]}, r"week says the window, and is among the features"),
    "twice": (pd.concat([marketing(), marketing()]), {}, r"rows 0 and 84 are the same, and so are 84 pairs"),
    "copies, guessed": (
        pd.concat([marketing(1), marketing(1)]).assign(day=lambda f: f.day.dt.dayofyear), {"time": False},
        r"rows 0 and 28 are the same in all columns; 28 rows are copies.*drop_duplicates\)\. As they are, the rows of",
    ),
    "mixed": (_set("tv", 5, "1,5"), {}, r"tv of row 5 is '1,5', and most others are numbers"),
    "text label": (_set("sales", 5, "none"), {}, r"sales of row 5 is 'none', and it is the label"),
    "infinite": (_set("tv", 5, np.inf), {}, r"tv of row 5 is inf; it must be finite"),
    "no window": (_set("week", 9, np.nan), {}, r"week of row 9 is missing, and it says the row's window"),
    "no time": (_set("day", 9, pd.NaT), {}, r"day of row 9 is missing, and it is the time"),
    "no group": (_set("region", 9, None), {}, r"region of row 9 is missing"),
    "no bits": (marketing(), {"label_is": "binary"}, r"data\.label_is=binary allows 0 and 1"),
    "baseline": (marketing(), {"baseline": {"tw": 0}}, r"data\.baseline names 'tw', .*did you mean 'tv'"),
    "baseline's value": (marketing(), {"baseline": {"tv": "off"}}, r"data\.baseline of tv is 'off'"),
    "stock": (marketing(), {"stock": ["sky"]}, r"data\.stock names 'sky', which holds words"),
    "propensity": (_but(p=1.5), {"propensity": "p"}, r"p of row 0 is 1\.5; data\.propensity is a probability"),
    "dates": (_but(due=lambda f: f.day), {"states": ["due"]}, r"due holds dates.*data\.calendar"),
    "no rows": (marketing().iloc[:0], {}, r"has no rows"),
    "names twice": (pd.concat([marketing(), marketing()[["tv"]]], axis=1), {}, r"two columns are called 'tv'"),
    "lists": (_but(week=lambda f: [[1]] * len(f)), {}, r"week holds neither numbers nor words"),
    "no table": ([1, 2], {}, r"1 \(int\) is no table; give a path"),
    "unknown word": (marketing(), {"windw": "week"}, r"data\.windw: .*did you mean 'window'"),
    "two roles": (marketing(), {"states": ["tv"], "actions": ["tv"]}, r"'tv' is in data\.states and in data\.actions"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name: str) -> None:
    data, given, message = BAD[name]
    with pytest.raises(UserError, match=message):
        opened(data, {**ROLES, **given})


@pytest.mark.parametrize("memory", [2**29, 100])
def test_a_column_of_many_words_is_refused_or_left_out(memory: int, tmp_path: Path) -> None:
    frame = marketing(10, 98)
    frame["note"] = [f"n{i % 450}" for i in range(len(frame))]
    frame.to_parquet(tmp_path / "x.parquet", index=False)
    with pytest.raises(UserError, match="note has more than 200 different values"):
        opened(tmp_path / "x.parquet", {**ROLES, "states": ["note"]}, memory=memory)
    panel = opened(tmp_path / "x.parquet", {}, memory=memory)
    assert any("note is left out: it has 450 different words" in sentence for sentence in panel.said)


def test_labels_of_a_second_table_must_fit() -> None:
    frame = marketing().drop(columns="sales")
    weeks = pd.DataFrame({"region": "r0", "week": [0, 1, 2, 2], "sales": [1.0, 2, 3, 4]})
    given = {key: value for key, value in ROLES.items() if key != "label"}
    with pytest.raises(UserError, match="week 2 is there twice, again in row 3"):
        opened(frame, {**given, "labels": weeks})
    with pytest.raises(UserError, match="none of its windows"):
        opened(frame, {**given, "labels": weeks.iloc[:3].assign(region="x")})
    with pytest.raises(UserError, match="no column 'region', and several groups"):
        opened(frame, {**given, "labels": weeks.iloc[:3].drop(columns="region")})
    more = pd.DataFrame({"region": "r0", "week": [0, 1, 9], "sales": [1.0, 2, 3]})
    panel = opened(frame, {**given, "labels": more})
    assert int(panel.windows.labelled.sum()) == 2
    assert any("1 of the 3 windows" in sentence for sentence in panel.said)


@pytest.mark.parametrize("how", ["as they lie", "within windows", "all"])
@pytest.mark.parametrize("memory", [2**29, 100])
def test_a_time_that_begins_anew_orders_rows_within_their_windows(how: str, memory: int, tmp_path: Path) -> None:
    frame = decisions()
    expected = opened(frame, {"states": ["state"], "actions": ["action"]})
    assert expected.windows.id.tolist() == [*range(120)]
    rng = np.random.default_rng(0)
    order = {
        "as they lie": np.arange(len(frame)),
        "within windows": np.concatenate([3 * w + rng.permutation(3) for w in range(120)]),
        "all": rng.permutation(len(frame)),
    }[how]
    frame.iloc[order].to_parquet(tmp_path / "data.parquet", index=False)
    for given in ({}, {"time": "t"}):
        panel = opened(tmp_path / "data.parquet", {"states": ["state"], "actions": ["action"], **given}, memory=memory)
        np.testing.assert_array_equal(panel.windows.label, expected.windows.label)
        ours, theirs = whole(panel), whole(expected)
        assert ours.state.tolist() == theirs.state.tolist()
        assert order[ours.index].tolist() == [*range(len(frame))]
        assert any("sorted by window, t" in one for one in panel.said) == (how != "as they lie")


def test_a_second_table_says_whether_series_are_told_apart() -> None:
    frame = decisions()
    labels = frame[frame.t == 2][["window", "label"]]
    panel = opened(frame.drop(columns="label"), {"labels": labels})
    assert (panel.roles.group, len(panel.windows)) == (None, 120)
    np.testing.assert_array_equal(panel.windows.label, labels.label)


def _twice(frame: pd.DataFrame, *rows: int) -> pd.DataFrame:
    return pd.concat([frame, frame.iloc[[*rows]]]).sort_index(kind="stable").reset_index(drop=True)


@pytest.mark.parametrize("how", ["numbered days", "dates", "episodes", "episodes, said"])
def test_copies_of_rows_are_refused_where_a_time_tells_rows_apart(how: str, tmp_path: Path) -> None:
    frame = marketing(1).drop(columns="region") if how != "episodes" else decisions()
    given: dict[str, Any] = {}
    if how == "numbered days":
        frame["day"] = np.arange(len(frame))
    elif how != "dates":
        frame, given = decisions(), {"time": "t"} if "said" in how else {}
    _twice(frame, 3, 9, 9).to_csv(tmp_path / "data.csv", index=False)
    opened(frame, given)
    for memory in (2**29, 100):
        with pytest.raises(UserError, match=r"rows 3 and 4 are the same in all columns; 3 rows are copies of others"):
            opened(tmp_path / "data.csv", given, memory=memory)
    if not given:
        panel = opened(_twice(frame, 3), {"time": False, "window": "week" if how[0] in "nd" else "window"})
        assert any("rows 3 and 4 are the same in all columns; they are taken as" in one for one in panel.said)


def test_equal_rows_of_logs_without_a_time_are_said_with_their_number() -> None:
    frame = decisions().drop(columns="t")
    panel = opened(frame)
    equal = int(frame.duplicated().sum())
    assert equal > 20
    assert panel.rows == len(frame)
    assert any(f"{equal} rows are copies of others; they are taken as rows that all happened" in s for s in panel.said)
