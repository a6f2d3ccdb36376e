"""Run folders, checkpoints, YAML files and imports of the version before the redesign are read, or answered."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

import credit
from credit import renamed
from credit.config import classes, files, kinds, registry
from credit.config.identity import identity
from credit.core.errors import UserError
from credit.core.naming import registered_name
from credit.report.compare import compare
from credit.report.runs import load_runs
from credit.runs import folders, job

HERE = Path(__file__).parent / "before"
WORDS = ["trainer.steps=210", "trainer.log_every=5", "tracking=none"]
SLUG = "trainer.log_every=5,trainer.steps=210"
CLASSES = [
    (kind, classes.resolve(name, node))
    for kind in kinds.KINDS
    for name, path in files.options(kind).items()
    if "_target_" in (node := yaml.safe_load(path.read_text(encoding="utf-8")) or {})
]


@pytest.fixture
def output(tmp_path: Path) -> Path:
    return Path(shutil.copytree(HERE / "runs", tmp_path / "runs"))


def test_a_finished_run_is_loaded(output: Path) -> None:
    run = credit.load(output / "advertiser/reference" / SLUG / "seed-0")
    assert run.config["feedback"]["_target_"] == "credit.envs.feedback.BlockSum"
    assert run.metrics.index[-1] == 210
    assert run.recovery is not None
    assert list(run.recovery["models"]) == ["ridge"]


def test_a_finished_run_is_known_to_be_done(output: Path) -> None:
    config = job.checked(registry.compose(["method=reference", "replicas=2", f"output={output}", *WORDS]))
    found = folders.find(config, output / "advertiser/reference" / SLUG)
    assert (found.done, found.groups) == ((0, 1), ())
    result = credit.run(["method=reference", "replicas=3", f"output={output}", *WORDS])
    assert (result.skipped, result.computed) == ([0, 1], [2])


@pytest.mark.thorough
def test_finished_runs_are_compared(output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    credit.run(["method=reference", "replicas=1", "seed=2", f"output={output}", *WORDS])
    assert list(load_runs(output, "advertiser").frame["seed"]) == [0, 1, 2]
    assert "0–2" in next(file for file in compare(output, "advertiser").files if file.suffix == ".md").read_text()


def test_an_interrupted_run_is_refused_with_a_reason_and_nothing_is_lost(output: Path) -> None:
    folder = output / "advertiser/delayed" / SLUG / "seed-0"
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    with pytest.raises(UserError, match=r"other code than this credit's .* compute the run anew with rerun=true"):
        credit.resume(folder)
    after = {file.name: file.read_bytes() for file in folder.iterdir() if file.name != ".lock"}
    assert after == {name: content for name, content in before.items() if name != ".lock"}


def test_every_class_that_was_registered_has_a_name_today() -> None:
    targets = [*renamed.CLASSES, "credit.bonuses.Count", "credit.rewards.table.TableModel", "credit.scaler.Standard"]
    for target in targets:
        classes.resolve("old", {"_target_": renamed.today(target)})
    assert renamed.today("credit.recovery.recovery.Recovery") == "credit.recovery.recovery.Recovery"
    assert renamed.today("somebody.elses.Part") == "somebody.elses.Part"


@pytest.mark.parametrize("module", sorted(renamed.MODULES))
def test_an_old_import_is_answered(module: str) -> None:
    __import__(renamed.MODULES[module])
    package = Path(credit.__file__).parents[1] / module.replace(".", "/")
    if package.is_dir() or package.with_suffix(".py").exists():
        pytest.skip("the name is a room's now")
    with pytest.raises(ModuleNotFoundError, match=r"is credit\..* since"):
        __import__(module)


def test_an_old_target_is_answered() -> None:
    config = registry.compose(["tracking=none"])
    config["mixer"] = {"_target_": "credit.mixers.RelativeMSE", "alpha": 0.5}
    (problem,) = job.check(config).problems
    assert "has another name now: credit.recovery.mixers.RelativeMSE" in problem


def test_registered_names_are_unique_within_their_kind() -> None:
    names: dict[tuple[str, str], type] = {}
    for kind, cls in CLASSES:
        assert names.setdefault((kind, registered_name(cls.__module__, cls.__name__)), cls) is cls


def test_paths_titles_and_circumstances_are_no_part_of_an_identity() -> None:
    config = job.checked(registry.compose(["tracking=none"]))
    same = config | {"title": "Another", "seed": 7, "replicas": 3, "output": "elsewhere", "rerun": True}
    assert identity(same) == identity(config)
    mixer = {key: value for key, value in config["mixer"].items() if key != "epsilon"}
    assert identity(config | {"mixer": mixer}) == identity(config)  # a key that is not said has its default
    assert identity(config | {"mixer": mixer | {"alpha": 1}}) == identity(config | {"mixer": mixer | {"alpha": 1.0}})


@pytest.mark.parametrize("word", ["mixer.alpha=.4", "env.gain=.06", "trainer.steps=700", "bonus.count.scale=.2"])
def test_what_decides_a_result_is_part_of_it(word: str) -> None:
    plain, other = (job.checked(registry.compose(["tracking=none", *words])) for words in ([], [word]))
    assert identity(plain) != identity(other)


def test_a_class_of_another_package_bears_its_name() -> None:
    class Mine:
        """A class."""

    Mine.__module__ = "somebody.parts"
    assert registered_name(Mine.__module__, Mine.__name__) == "somebody:mine"


@pytest.mark.parametrize(
    ("word", "now"),
    [
        ("recovery=step_recovery", "assigner=recovery"),
        ("oracle=primitive_steps", "reward@reference=primitive"),
        ("assigner=step_recovery", "write assigner=recovery|assigner=recovery"),
        ("reward@reference=primitive_steps", "reward@reference=primitive"),
    ],
)
def test_an_old_option_is_answered(word: str, now: str) -> None:
    with pytest.raises(UserError, match=f"{word}: this is gone; .*({now})"):
        registry.compose(["experiment=pointmaze", word])
