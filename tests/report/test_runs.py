from pathlib import Path

import numpy as np
import pytest

from credit.core.errors import UserError
from credit.report.runs import describe_seeds, load_curves, load_runs
from credit.runs import job
from credit.runs.load import load

from .conftest import TRAINER, WriteRun

REGRET = {"regret/cumulative": 100.0}


def test_loads_final_metrics_sorted_by_seed(write_run: WriteRun, tmp_path: Path):
    for seed in (10, 2):
        write_run("reference", seed, {"regret/cumulative": float(seed), "reward/mse": None})
    runs = load_runs(tmp_path / "outputs", "advertiser")
    assert runs.frame["seed"].tolist() == [2, 10]
    assert runs.frame["regret/cumulative"].tolist() == [2.0, 10.0]
    assert runs.frame["name"].unique().tolist() == ["Ridge-UCB"]
    assert runs.metrics == ["regret/cumulative"]


def test_unfinished_runs_are_counted_and_not_used(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, REGRET)
    folder = write_run("reference", 1, REGRET, done=False)
    runs = load_runs(tmp_path / "outputs", "advertiser")
    assert runs.frame["seed"].tolist() == [0]
    assert runs.unfinished == (folder,)


def test_filters(write_run: WriteRun, tmp_path: Path):
    for method in ("reference", "block"):
        for seed in range(5):
            write_run(method, seed, REGRET)
    write_run("block", 2, REGRET, slug="ties-random")
    output = tmp_path / "outputs"
    chosen = load_runs(output, "advertiser", methods=["block"], slugs=["default"], seed=1, replicas=3).frame
    assert chosen[["method", "slug", "seed"]].to_numpy().tolist() == [["block", "default", seed] for seed in (1, 2, 3)]
    assert load_runs(output, "advertiser", seed=3).frame["seed"].unique().tolist() == [3, 4]
    assert load_runs(output, "advertiser", replicas=2).frame["seed"].unique().tolist() == [0, 1]


def test_different_configurations_are_not_averaged(write_run: WriteRun, tmp_path: Path):
    alpha = {"_target_": "credit.recovery.mixers.RelativeMSE", "alpha": 0.4}
    write_run("reference", 0, REGRET, config_hash="aaaa", mixer=alpha)
    write_run("reference", 1, REGRET, config_hash="bbbb")
    write_run("block", 0, REGRET)
    with pytest.raises(UserError, match=r"reference/default: aaaa \(seeds 0 \(1\)\), bbbb \(seeds 1 \(1\)\)"):
        load_runs(tmp_path / "outputs", "advertiser")
    assert len(load_runs(tmp_path / "outputs", "advertiser", seed=1).frame) == 1


def test_the_same_configuration_under_another_hash_is_the_same(write_run: WriteRun, tmp_path: Path):
    """Hashes of versions before are of Python paths, too; what is compared is today's identity."""
    write_run("reference", 0, REGRET, config_hash="aaaa")
    write_run("reference", 1, REGRET, config_hash="bbbb")
    assert len(load_runs(tmp_path / "outputs", "advertiser").frame) == 2


def test_a_configuration_that_is_missing_where_two_are_compared_is_named(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, REGRET, config_hash="aaaa")
    write_run("reference", 1, REGRET, config_hash="bbbb")
    (write_run("reference", 2, REGRET, config_hash="bbbb") / "config.yaml").unlink()
    assert len(load_runs(tmp_path / "outputs", "advertiser").frame) == 3  # what nobody looks at is not missed
    (tmp_path / "outputs/advertiser/reference/default/seed-0/config.yaml").unlink()
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its config\.yaml is missing"):
        load_runs(tmp_path / "outputs", "advertiser")
    with pytest.raises(UserError, match=r"config\.yaml: missing; restore it"):
        job.read(tmp_path / "outputs/advertiser/reference/default/seed-0")


def test_a_damaged_run_of_a_setting_that_is_not_asked_for_is_left_out(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, {"regret/cumulative": 1.0})
    longer = {**TRAINER, "steps": 700}
    damaged = write_run("reference", 0, {"regret/cumulative": 1.0}, slug="trainer.steps=700", trainer=longer)
    (damaged / "summary.json").write_text("{", encoding="utf-8")
    chosen = load_runs(tmp_path / "outputs", "advertiser", where={"trainer.steps": 14000})
    assert len(chosen.frame) == 1
    for where in ({"trainer.steps": 700}, None):
        with pytest.raises(UserError, match=r"trainer\.steps=700/seed-0 is marked as finished, but its summary\.json"):
            load_runs(tmp_path / "outputs", "advertiser", where=where)
    (damaged / "config.yaml").unlink()  # nobody knows of which setting it is
    with pytest.raises(UserError, match=r"its summary\.json cannot be used"):
        load_runs(tmp_path / "outputs", "advertiser", where={"trainer.steps": 14000})


def test_a_damaged_run_is_named(write_run: WriteRun, tmp_path: Path):
    folder = write_run("reference", 0, REGRET)
    (folder / "summary.json").write_text("{", encoding="utf-8")
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its summary\.json"):
        load_runs(tmp_path / "outputs", "advertiser")


@pytest.mark.parametrize("content", ["[1]", "null", '{"metrics": 3}', "{"])
def test_a_summary_that_is_none_is_named_and_nothing_is_to_be_deleted(
    write_run: WriteRun, tmp_path: Path, content: str
):
    (write_run("reference", 0, REGRET) / "summary.json").write_text(content, encoding="utf-8")
    with pytest.raises(UserError, match=r"summary\.json cannot be used .* Restore the file, or move the folder"):
        load_runs(tmp_path / "outputs", "advertiser")


@pytest.mark.parametrize("content", ["", "time,regret/cumulative\n1,2\n", "step,regret/cumulative\n1,many\n"])
def test_a_damaged_journal_is_named(write_run: WriteRun, tmp_path: Path, content: str):
    (write_run("reference", 0, REGRET) / "metrics.csv").write_text(content, encoding="utf-8")
    with pytest.raises(UserError, match=r"seed-0 is marked as finished, but its metrics\.csv cannot be used"):
        load_curves(load_runs(tmp_path / "outputs", "advertiser").frame, "regret/cumulative")


HEAD = "step,regret/cumulative,reward/mse\n100,1,2\n"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (HEAD + "200,many,3\n", r"line 3: regret/cumulative is 'many', and it must be a number"),
        (HEAD + "200,2\n", r"line 3: 2 columns, and line 1 has 3"),
        (HEAD + "200,2,3,4\n", r"line 3: 4 columns, and line 1 has 3"),
        (HEAD + "\n200,2,3\n", r"line 3: 1 columns, and line 1 has 3"),
        (HEAD + "200,2,3\n150,3,4\n", r"line 4: step 150 after 200; steps are whole and rise from row to row"),
        (HEAD + "100,2,3\n", r"line 3: step 100 after 100"),
        (HEAD + ",2,3\n", r"line 3: step nan after 100"),
        (HEAD + "200.5,2,3\n", r"line 3: step 200.5 after 100; steps are whole"),
        (HEAD + "inf,2,3\n", r"line 3: step inf after 100"),
        (HEAD + "200,2,3", r"line 3: it is cut short"),
        ("step,regret/cumulative,reward/mse\n", r"line 2: there is none"),
        ("step,regret/cumulative,regret/cumulative\n1,2,3\n", r"line 1: two columns 'regret/cumulative'"),
        ("step,reward/mse\n100,2\n", r"line 1: no column 'regret/cumulative', of which the run ended with"),
        (HEAD + "200,\xff,3\n", r"decode"),
        ("", r"line 1: no column 'step'"),
        (None, r"metrics\.csv is missing"),
    ],
)
def test_what_is_damaged_in_a_journal_is_told_with_its_line(
    write_run: WriteRun, tmp_path: Path, content: str | None, said: str
):
    file = write_run("reference", 0, REGRET) / "metrics.csv"
    write_run("reference", 1, REGRET)
    file.unlink() if content is None else file.write_bytes(content.encode("latin-1"))
    frame = load_runs(tmp_path / "outputs", "advertiser").frame
    for read in (lambda: load_curves(frame, "regret/cumulative"), lambda: load(file.parent)):
        with pytest.raises(UserError, match=rf"seed-0 is marked as finished, but its .*{said}.* Restore the file"):
            read()


@pytest.mark.parametrize("name", ["config.yaml", "metrics.csv", "summary.json", "recovery.npz"])
def test_a_run_with_a_damaged_file_is_not_loaded(write_run: WriteRun, name: str):
    folder = write_run("reference", 0, REGRET, recovery={"models": np.array(["ridge"])})
    assert load(folder).metrics.index.tolist() == [100, 200, 300]
    (folder / name).write_text("[{: ", encoding="utf-8")
    with pytest.raises(UserError, match=rf"its {name} cannot be used"):
        load(folder)


def test_curves_on_the_same_steps_are_stacked(write_run: WriteRun, tmp_path: Path):
    for seed in (0, 1):
        write_run("reference", seed, {"regret/cumulative": 30.0 * (seed + 1), "reward/mse": None})
    frame = load_runs(tmp_path / "outputs", "advertiser").frame
    curves = load_curves(frame, "regret/cumulative")
    assert curves is not None
    assert curves[0].tolist() == [100, 200, 300]
    assert curves[1].round(9).tolist() == [[10, 20, 30], [20, 40, 60]]
    assert load_curves(frame, "reward/mse") is None
    assert load_curves(frame, "eval/success") is None


def test_curves_on_different_steps_are_interpolated(write_run: WriteRun, tmp_path: Path):
    write_run("reference", 0, {"eval/success": 1.0}, steps=(0, 100, 200))
    write_run("reference", 1, {"eval/success": 1.0}, steps=(0, 50, 100))
    curves = load_curves(load_runs(tmp_path / "outputs", "advertiser").frame, "eval/success")
    assert curves is not None
    assert curves[0].tolist() == [0, 50, 100]
    assert curves[1].tolist() == [[0, 0.25, 0.5], [0, 0.5, 1.0]]


def test_seeds_are_described_as_a_range():
    assert describe_seeds([4]) == "4 (1)"
    assert describe_seeds([0, 1, 5]) == "0–5 (3)"
