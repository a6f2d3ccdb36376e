"""The page that a dashboard opens on: it takes a browser to the newest curves.

By itself MLflow opens on a welcome page, folds a sweep, and draws its charts in alphabetical order. What its
UI shows is kept in the browser's local storage, so a page of the same origin can put the newest sweep and the
charts that matter there before it hands over. A UI that does not know these entries ignores them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Run

PASS = "ui"  # the query that asks for MLflow itself
SHOWN = ("regret/cumulative", "policy/error", "eval/success", "reward/mse", "return/label")
OPEN_SECTIONS = ("regret", "policy", "eval", "reward", "return", "weight", "best", "optimizer", "time")
FOLDED_SECTIONS = ("interval", "report")
PARALLEL, AXES = "credit-parallel", 6  # of what differs, as many as can be read
LETTERS = 14  # of a name, at least: above them stands the sweep
NAME, WHEN = "attributes.`Run Name`", "runDateAndNestInfo"  # columns that are always there
MANY = 6  # jobs, beyond which a chart of all their intervals is a thicket
PAGE = 100  # runs that MLflow's UI loads at first
_SETTINGS = {
    "mlflow.workflowType_v1": "machine_learning",
    "mlflow.assistant.panelOpen_v1": False,
    "mlflow.assistant.fab.autoOpenedOnFirstLoad_v1": True,
}
_HTML = """<!doctype html><meta charset="utf-8"><title>credit</title><script>
const {settings, store, view, address} = %s;
try {
  for (const name in settings) localStorage[name] ??= JSON.stringify(settings[name]);
  if (store) {
    const state = {...view.first, ...JSON.parse(localStorage[store] ?? "{}")};
    if (localStorage["credit:" + store] !== view.session) {  // a new sweep has columns of its own
      Object.assign(state, view.sweep);
      const own = view.first.compareRunCharts.find(chart => chart.uuid === view.parallel);
      state.compareRunCharts = state.compareRunCharts?.map(chart => own && chart.uuid === own.uuid ? own : chart);
      localStorage["credit:" + store] = view.session;
    }
    state.runsExpanded = {...state.runsExpanded, ...view.expanded};
    state.runsVisibilityMap = {...state.runsVisibilityMap, ...view.visible};
    localStorage[store] = JSON.stringify(state);
  }
} finally { location.replace(address); }
</script>"""


def landing_page(client: MlflowClient) -> str:
    """The HTML that opens the newest experiment's curves: a line a method, the seeds one click below."""
    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    jobs = client.search_runs(experiments, "tags.level = 'job'", max_results=PAGE, order_by=["start_time DESC"])
    if not jobs:
        return _page(f"/?{PASS}#/experiments")
    newest = jobs[0]
    experiment, session = newest.info.experiment_id, newest.data.tags["session"]
    jobs = [run for run in jobs if run.info.experiment_id == experiment]
    sweep = next(filter(None, map(_parent, jobs)), None)
    loaded = client.search_runs([experiment], max_results=PAGE, order_by=["start_time DESC"])
    within = {run.info.run_id for run in loaded} | {_parent(run) for run in loaded}
    wanted = [run for run in jobs if run.data.tags["session"] == session or (sweep and _parent(run) == sweep)]
    if not {run.info.run_id for run in wanted} <= within:
        # Too many seeds for the UI's first page: a flat list of the methods shows them all.
        return _page(f"/?{PASS}{_flat(experiment, session)}", experiment, _view(None, [], jobs))
    bare = [run.info.run_id for run in loaded if run.data.tags.get("level") in ("sweep", "report")]
    view = _view(sweep, [*bare, sweep] if sweep else bare, jobs)
    query = "compareRunsMode=CHART&searchFilter=&orderByKey=attributes.start_time&orderByAsc=false"
    return _page(f"/?{PASS}#/experiments/{experiment}/runs?{query}", experiment, view)


def newest_view(client: MlflowClient) -> str:
    """What to append to a server's address to see the newest session's methods, without their seeds."""
    experiments = [experiment.experiment_id for experiment in client.search_experiments()]
    jobs = client.search_runs(experiments, "tags.level = 'job'", max_results=1, order_by=["start_time DESC"])
    return _flat(jobs[0].info.experiment_id, jobs[0].data.tags["session"]) if jobs else ""


def _flat(experiment: str, session: str) -> str:
    chosen = f"tags.level%3D%22job%22%20and%20tags.session%3D%22{session}%22"
    query = f"workflowType=machine_learning&compareRunsMode=CHART&searchFilter={chosen}"
    return f"#/experiments/{experiment}/runs?{query}&orderByKey=tags.%60method%60&orderByAsc=true"


def _parent(run: Run) -> str | None:
    parent: str | None = run.data.tags.get("mlflow.parentRunId")
    return parent


def _page(address: str, experiment: str | None = None, view: dict[str, Any] | None = None) -> str:
    store = f'MLflowLocalStorage-1.1-ExperimentPage-["{experiment}"]-ReactComponentState' if experiment else None
    content = {"settings": _SETTINGS, "store": store, "view": view, "address": address}
    return _HTML % json.dumps(content).replace("<", "\\u003c")


def _view(sweep: str | None, hidden: Iterable[str], jobs: list[Run]) -> dict[str, Any]:
    """What the UI shall show: at the first visit these charts, at every visit these runs."""
    names = {name for run in jobs for name in run.data.metrics}
    main = jobs[0].data.tags.get("metric", SHOWN[0])
    shown = [[name] for name in dict.fromkeys((main, *SHOWN)) if name in names]
    newest = [run for run in jobs if run.data.tags["session"] == jobs[0].data.tags["session"]]
    differing = list(dict.fromkeys(key for run in newest for key in json.loads(run.data.tags.get("differing", "[]"))))
    differing = [key for key in differing if any(key in run.data.params for run in newest)]
    band = {f"interval/{shown[0][0].replace('/', '_')}_{end}" for end in ("low", "high")} if shown else set()
    if band and band <= names and len(newest) <= MANY:
        shown.insert(1, [*shown[0], *sorted(band)])
    charts = [_chart(f"credit-chart-{number}", metrics) for number, metrics in enumerate(shown)]
    if shown and differing:
        charts.append(_parallel(shown[0][:1], differing[:AXES]))
    prefixes = {name.partition("/")[0] for name in names if "/" in name} | {"report"}
    sections = [_section("overview", folded=False)] if charts else []
    sections += [_section(name, folded=False) for name in OPEN_SECTIONS if name in prefixes]
    sections += [_section(name, folded=True) for name in FOLDED_SECTIONS if name in prefixes]
    first = {
        "runsHiddenMode": "SHOWALL",
        "compareRunCharts": charts,
        "compareRunSections": sections,
        "isAccordionReordered": True,
    }
    own = {name for run in newest for name in run.data.metrics}
    measured = list(dict.fromkeys(f"metrics.`{metrics[0]}`" for metrics in shown if metrics[0] in own))
    columns = [*measured[:1], *(f"params.`{key}`" for key in differing), *measured[1:]]
    letters = max(LETTERS, *(len(str(run.info.run_name)) for run in newest))
    return {
        "first": first,
        "session": jobs[0].data.tags["session"],
        "sweep": {
            "selectedColumns": columns,
            "columnOrder": [NAME, WHEN, *columns],
            "columnWidths": {NAME: min(110 + 7 * letters, 480), WHEN: 150} | {key: 7 * len(key) for key in columns},
        },
        "parallel": PARALLEL,
        "expanded": {sweep: True} if sweep else {},
        "visible": dict.fromkeys(hidden, False),
    }


def _section(name: str, folded: bool) -> dict[str, Any]:
    return {"uuid": f"credit-{name}", "name": name, "display": not folded, "isReordered": False}


def _parallel(metrics: list[str], params: list[str]) -> dict[str, Any]:
    """Parallel coordinates: what differs, and what comes of it."""
    return {
        "uuid": PARALLEL,
        "type": "PARALLEL",
        "metricSectionId": "credit-overview",
        "deleted": False,
        "isGenerated": False,
        "selectedMetrics": metrics,
        "selectedParams": params,
        "showAllRuns": False,
    }


def _chart(identity: str, metrics: list[str]) -> dict[str, Any]:
    return {
        "uuid": identity,
        "type": "LINE",
        "metricSectionId": "credit-overview",
        "deleted": False,
        "isGenerated": False,
        "displayName": metrics[0],
        "metricKey": metrics[0],
        "selectedMetricKeys": metrics,
        "displayPoints": False,
        "lineSmoothness": 0,
        "scaleType": "linear",
        "xAxisScaleType": "linear",
        "xAxisKey": "step",
        "selectedXAxisMetricKey": "",
        "yAxisKey": "metric",
        "yAxisExpressions": [],
        "range": {},
        "ignoreOutliers": False,
        "useGlobalXaxisKey": True,
        "useGlobalLineSmoothing": True,
    }
