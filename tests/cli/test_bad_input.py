"""Bad input: exit code 2, a message with the key, the value, what is allowed and the nearest name, and nothing made."""

from __future__ import annotations

import numpy as np
import pytest

TRAIN = "train"
CASES = {
    "unknown option": ((TRAIN, "method=disagrement"), ["method=disagrement", "'disagreement'", "valid:"]),
    "a path for an option": ((TRAIN, "experiment=../x"), ["experiment=../x: no such option", "advertiser"]),
    "a path to an option": ((TRAIN, "mixer=../agent/sac"), ["mixer=../agent/sac: no such option", "relative_mse"]),
    "an absolute path for an option": ((TRAIN, "method=/etc/x"), ["method=/etc/x: no such option", "disagreement"]),
    "a path in a list": ((TRAIN, "bonus=[count,../x]"), ["bonus=../x: no such option", "local_mse"]),
    "a list where one belongs": ((TRAIN, "mixer=[best,uniform]"), ["mixer is one option and no list", "mixer=a,b"]),
    "a list of methods": ((TRAIN, "method=[]"), ["method is one option and no list"]),
    "a model without its place": ((TRAIN, "reward=dnn"), ["'reward=dnn'", "reward@reference=…"]),
    "a model in no place": ((TRAIN, "reward@surrogates=dnn"), ["+reward@surrogates.NAME=…"]),
    "an option with a space": ((TRAIN, "method='a b'"), ["method=a b: no such option", "disagreement"]),
    "no option at all": ((TRAIN, "method="), ["method=: no such option", "disagreement"]),
    "an option of another group": ((TRAIN, "experiment=riverswim"), ["riverswim is an option of env", "env=riverswim"]),
    "unknown option in a list": ((TRAIN, "bonus=[cout]"), ["bonus=cout", "'count'", "local_mse"]),
    "unknown option of a packaged group": (
        (TRAIN, "reward@reference=rigde"),
        ["rigde", "'ridge'", "threshold"],
    ),
    "demonstrations that are nowhere": (
        (TRAIN, "demonstrations_from=log.csv"),
        ["demonstrations_from: log.csv: there is no such file"],
    ),
    "policy that is nowhere": ((TRAIN, "policy_from=none"), ["policy_from=none", "keep=[agent]"]),
    "unknown group": ((TRAIN, "mixr.alpha=1"), ["mixr", "'mixer'", "mixr.alpha=1"]),
    "unknown key": ((TRAIN, "mixer.alfa=1"), ["mixer.alfa=1", "'alpha'", "epsilon"]),
    "unknown key, added": ((TRAIN, "+mixer.alfa=1"), ["mixer.alfa", "value 1", "'alpha'"]),
    "unknown key at the top": ((TRAIN, "+sed=1"), ["sed", "'seed'"]),
    "key that this method lacks": (
        (TRAIN, "method=reference", "mixer.alpha=.3"),
        ["mixer.alpha=.3", "ReferenceOnly"],
    ),
    "key of a part that this method does not use": (
        (TRAIN, "method=delayed", "mixer.alpha=.3"),
        ["'mixer.alpha=.3' has no effect", "method=delayed uses no mixer", "adaptive_mse"],
    ),
    "part that this method does not use": (
        (TRAIN, "method=delayed", "mixer=best", "+reward@surrogates.more=ridge"),
        ["'mixer=best' has no effect", "'+reward@surrogates.more=ridge' has no effect", "uses no surrogates"],
    ),
    "part that no method uses here": (
        (TRAIN, "experiment=pointmaze", "transition=counts"),
        ["'transition=counts' has no effect", "no method does here"],
    ),
    "a word that has no effect in any job": (
        (TRAIN, "-m", "method=delayed,random", "mixer.alpha=.1,.3"),
        ["'mixer.alpha=0.1' has no effect", "'mixer.alpha=0.3' has no effect", "adaptive_mse"],
    ),
    "a role": ((TRAIN, "choose.planner=q_learning"), ["choose", "not for the command line", "agent=<option>"]),
    "a default of an option": ((TRAIN, "+defaults_for.x=1"), ["defaults_for", "mixer.alpha=.3"]),
    "wrong type": ((TRAIN, "mixer.alpha=abc"), ["mixer.alpha='abc'", "number", "float > 0"]),
    "wrong type in a list": ((TRAIN, "env.interaction=[0,x]"), ["env.interaction", "'x'", "list of float"]),
    "a whole number as a float": ((TRAIN, "trainer.steps=1e4"), ["trainer.steps=10000.0", "integer", "write 10000"]),
    "several problems of several kinds": (
        (TRAIN, "foo=1", "bar.x=2", "mixer.alpha=x", "method=adaptive_mse"),
        ["foo: unknown key", "bar: unknown key", "mixer.alpha='x'"],
    ),
    "a setting with dashes": ((TRAIN, "--seed", "3"), ["'--seed' is no option here", "write seed=3"]),
    "a setting of two words": ((TRAIN, "seed", "3"), ["'seed 3'", "without spaces", "write seed=3"]),
    "a setting with spaces": ((TRAIN, "mixer.alpha", "=", ".3"), ["'mixer.alpha = .3'", "write mixer.alpha=.3"]),
    "a sweep of two words": ((TRAIN, "-m", "seed=", "1,2"), ["'seed= 1,2'", "write seed=1,2"]),
    "the sweeper": ((TRAIN, "hydra.sweeper.params={a:1}"), ["hydra.sweeper.params={a:1}", "has no effect"]),
    "an interval": ((TRAIN, "-m", "bonus.count.scale=interval(0,1)"), ["interval(0,1)", "range(0,1,.25)"]),
    "float for an integer": ((TRAIN, "seed=1.5"), ["seed=1.5", "integer"]),
    "not a choice": (
        (TRAIN, "uncertainty.resample=often"),
        ["uncertainty.resample='often'", "poisson, exact"],
    ),
    "window 0": ((TRAIN, "feedback.window=0"), ["feedback.window=0", "≥ 1"]),
    "replicas 0": ((TRAIN, "replicas=0"), ["replicas=0", "≥ 1"]),
    "draws 0": ((TRAIN, "uncertainty.draws=0"), ["uncertainty.draws=0", "≥ 1"]),
    "negative λ": ((TRAIN, "reference.regularization=-1"), ["reference.regularization=-1", "> 0"]),
    "infinite": ((TRAIN, "bonus.count.scale=inf"), ["bonus.count.scale=inf", "finite"]),
    "probability above 1": ((TRAIN, "env.p_down=1.5"), ["env.p_down=1.5", "≤ 1"]),
    "probabilities that do not fit": (
        (TRAIN, "env.p_mid_up=.9"),
        ["env.p_mid_down + env.p_mid_up = 1.2", "at most 1"],
    ),
    "missing value": ((TRAIN, "mixer.alpha=???"), ["mixer.alpha", "missing", "float > 0"]),
    "missing part": ((TRAIN, "~agent"), ["agent", "trainer needs one"]),
    "missing model": ((TRAIN, "~reward@reference"), ["reference", "add reward@reference=<option>"]),
    "parts of a list": ((TRAIN, "~bonus"), ["'~bonus'", "bonus=[]"]),
    "parts that do not fit": (
        (TRAIN, "agent=sac"),
        ["agent: SAC needs", "vectors (Box)"],
    ),
    "bonus without its model": (
        (TRAIN, "method=oracle", "bonus=[elliptical]"),
        ["Elliptical", "RidgeModel", "reference"],
    ),
    "too many macro-actions": (
        (TRAIN, "method=block", "feedback.window=20"),
        ["feedback.window=20", "100000"],
    ),
    "a table that fills the memory": (
        (TRAIN, "experiment=sepsis", "transition=counts"),
        ["1296 states", "transition=observed_counts"],
    ),
    "a continuing planner in episodes": (
        (TRAIN, "experiment=sepsis", "method=block", "agent=block_ucb"),
        ["agent: BlockUCB needs a task that is continuing, and this one is episodic"],
    ),
    "a key of an older version": ((TRAIN, "tuned.mixer_alpha=.3"), ["tuned.mixer_alpha=.3", "now mixer.alpha"]),
    "a key of a group's older name": (
        (TRAIN, "optimizer.discount=.9"),
        ["optimizer.discount=.9", "now agent.discount"],
    ),
    "a group's older name": ((TRAIN, "optimizer=dqn"), ["optimizer=dqn", "now agent"]),
    "a group of an older version": ((TRAIN, "planner=sac"), ["planner=sac", "write agent="]),
    "a horizon of 0": (
        (TRAIN, "experiment=sepsis", "feedback=terminal", "feedback.window=0"),
        ["feedback.window=0", "int ≥ 1"],
    ),
    "rounds longer than the run": (
        (TRAIN, "experiment=sepsis", "trainer.steps=20"),
        ["trainer.windows_per_round=10", "the 4 windows", "trainer.steps=20", "feedback.window=5", "at most 4"],
    ),
    "first rounds longer than the run": (
        (TRAIN, "trainer.steps=21", "trainer.first_windows_per_round=4"),
        ["trainer.first_windows_per_round=4", "the 3 windows", "at most 3"],
    ),
    "more random windows than the run has": (
        (TRAIN, "experiment=sepsis", "method=credit_hypotheses", "trainer.steps=125"),
        ["trainer.random_windows=50", "the 25 windows", "at most 25, or a longer run"],
    ),
    "moves up and down above 1 in all": (
        (TRAIN, "experiment=sepsis", "env.fluctuation=.6"),
        ["env.fluctuation=0.6", "≤ 0.5"],
    ),
    "start that does not sum to 1": (
        (TRAIN, "experiment=sepsis", "env.start_oxygen=[.2,.7,0]"),
        ["env.start_oxygen=[0.2, 0.7, 0]", "three probabilities", "sum to 1"],
    ),
    "start with a negative share": (
        (TRAIN, "experiment=sepsis", "env.start_heart_rate=[-.5,1,.5]"),
        ["env.start_heart_rate=[-0.5, 1, 0.5]", "three probabilities"],
    ),
    "start that is drawn again for ever": (
        (
            TRAIN,
            "experiment=sepsis",
            *(f"env.start_{vital}=[0,1,0]" for vital in ("heart_rate", "blood_pressure", "oxygen", "glucose")),
            "env.start_glucose_diabetes=[0,1,0]",
        ),
        ["env.start_*", "1 or 2 abnormal vitals", "again for ever", "above 0"],
    ),
    "labels held out by nobody": (
        (TRAIN, "mixer=stacking", "uncertainty=analytic"),
        ["Stacking needs a Bootstrap in uncertainty", "Analytic"],
    ),
    "method of another experiment": (
        (TRAIN, "method=credit_hypotheses"),
        ["method=credit_hypotheses", "experiment=sepsis only", "advertiser", "credit list"],
    ),
    "the step where windows follow each other": (
        (TRAIN, "reference.credit=last_step"),
        ["looks at the step", "windows follow each other", "an environment with episodes"],
    ),
    "s' beside (s, a)": (
        (TRAIN, "experiment=sepsis", "reference.looks_at=[step,next_state]"),
        ["look at step, state, action, next_state", "(s, a) or of s'", "looks_at, patient"],
    ),
    "a comma in a name": ((TRAIN, "reference.name='a,b'"), ["reference.name='a,b'", "letters, digits"]),
    "a line in a name": ((TRAIN, "reference.name='a\nb'"), ["reference.name='a\\nb'", "not allowed"]),
    "a path in a name": ((TRAIN, "reference.name='../x'"), ["reference.name='../x'", "not allowed"]),
    "a long name": ((TRAIN, f"reference.name={'x' * 260}"), ["reference.name='xxx", "100 bytes at most"]),
    "a title of two lines": ((TRAIN, "title='a\nb'"), ["title='a\\nb'", "one line"]),
    "patients in advertising": (
        (TRAIN, "+reward@surrogates.clinical=clinical", "surrogates.clinical.name=clinical"),
        ["Clinical needs SepsisKnowledge", "Advertiser gives LineKnowledge", "another environment"],
    ),
    "successes among labels that are no bits": (
        (TRAIN, "experiment=pointmaze", "feedback=block_sum", "feedback.window=300"),
        ["agent.prefer=success", "real numbers", "agent.prefer=top"],
    ),
    "shorter than a window": ((TRAIN, "trainer.steps=3"), ["trainer.steps=3", "feedback.window=7"]),
    "output is a file": ((TRAIN, "output=/dev/null/x"), ["output='/dev/null/x'", "/dev/null"]),
    "output cannot be made": ((TRAIN, "output=/proc/x"), ["output='/proc/x'", "not writable"]),
    "tracking URI": ((TRAIN, "tracking.uri=nowhere"), ["tracking.uri='nowhere'", "sqlite:///"]),
    "no such device": ((TRAIN, "device=tpu9"), ["device='tpu9'", "cpu, cuda"]),
    "not an override": ((TRAIN, "bonus=[count"), ["'bonus=[count'", "key=value"]),
    "sweep without -m": ((TRAIN, "method=delayed,reference"), ["method=delayed,reference", "-m"]),
    "bad job in a sweep": ((TRAIN, "-m", "mixer.alpha=.3,-1"), ["mixer.alpha=-1", "> 0"]),
    "unknown flag": ((TRAIN, "--multi"), ["--multi", "--multirun"]),
    "check as well": (("check", "replicas=0"), ["replicas=0"]),
    "unknown command": (("trian",), ["'trian'", "'train'"]),
    "unknown kind": (("list", "bonsu"), ["'bonsu'", "'bonus'"]),
    "unknown benchmark": (("bench", "tabluar"), ["'tabluar'", "'tabular'"]),
    "nothing to compare": (("compare", "experiment=advertiser"), ["credit train -m experiment=advertiser"]),
    "nothing to show": (("dashboard",), ["credit train"]),
}


LONGER = {"part that no method uses here", "key of a part that this method does not use"}  # all methods are asked


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        pytest.param(*case, id=name, marks=pytest.mark.thorough if name in LONGER else ())
        for name, case in CASES.items()
    ],
)
def test_is_refused_with_a_message(credit, folder, words, expected):
    ended = credit(*words)
    assert ended.code == 2
    assert "Traceback" not in ended.err
    for part in expected:
        assert part in ended.err
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("row", "between", "total"), [((1.25, 0, 0), "0 to 0.6125", "1.25"), ((-0.25, 0, 1), "-0.1225 to 0.49", "0.75")]
)
def test_a_row_that_is_no_distribution_is_named(credit, folder, monkeypatch, row, between, total):
    from credit.envs.sepsis.environment import Sepsis

    vitals = Sepsis._vitals

    def spoiled(self, *case):
        heart_rate, *rest = vitals(self, *case)
        if case == (1, (0, 1, 0), (1, 0, 1)):  # diabetes; vasopressors are stopped, antibiotics and ventilator given
            heart_rate = heart_rate.clone()
            heart_rate[2] = heart_rate.new_tensor(row)
        return heart_rate, *rest

    monkeypatch.setattr(Sepsis, "_vitals", spoiled)
    ended = credit("train", "experiment=sepsis")
    # The first such patient: diabetes, a high heart rate, all else low: (81 + 2·27)·8 + treatments 010 = 1082. Oxygen
    # rises with .7, glucose stays with .7: the row's largest entries are .49 of the heart rate's.
    assert ended.code == 2
    assert "transition row (s=1082, a=5) is no distribution" in ended.err
    assert f"its entries go from {between} and have the sum {total}" in ended.err
    assert "must lie in [0, 1] and sum to 1" in ended.err
    assert "Traceback" not in ended.err
    assert list(folder.iterdir()) == []


@pytest.mark.thorough
def test_an_episode_cut_short_is_allowed(credit, folder):
    words = ("method=disagreement", "trainer.steps=58", "trainer.windows_per_round=5", "replicas=1", "tracking=none")
    assert credit("train", "experiment=sepsis", *words).code == 0
    rows = next(folder.rglob("metrics.csv")).read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["step", "58"]
    with np.load(next(folder.rglob("recovery.npz"))) as arrays:
        assert arrays["windows/states"].shape == (11, 5)


def test_all_problems_at_once(credit):
    ended = credit("train", "mixer.alpha=abc", "replicas=0", "bonus.count.scale=-2")
    assert ended.code == 2
    for key in ("mixer.alpha", "replicas", "bonus.count.scale"):
        assert key in ended.err


YAML_CASES = {
    "unknown key": ("_target_: credit.recovery.mixers.RelativeMSE\nalfa: 0.5\n", ["mixer.alfa", "0.5", "'alpha'"]),
    "wrong type": (
        "_target_: credit.recovery.mixers.RelativeMSE\nalpha: often\n",
        ["mixer.alpha='often'", "float > 0"],
    ),
    "wrong kind": ("_target_: credit.recovery.bonuses.Count\n", ["mixer", "Count is not a Mixer"]),
    "foreign class": ("_target_: os.system\n", ["os.system", "only classes of", "credit"]),
    "no such class": (
        "_target_: credit.recovery.mixers.RelativMSE\n",
        ["credit.recovery.mixers.RelativMSE", "cannot be imported"],
    ),
    "not a component": (
        "_target_: credit.recovery.mixers.median\n",
        ["credit.recovery.mixers.median", "not a component"],
    ),
}


@pytest.mark.parametrize(("text", "expected"), YAML_CASES.values(), ids=YAML_CASES.keys())
def test_mistakes_inside_a_yaml_file(credit, folder, text, expected):
    (folder / "mine" / "mixer").mkdir(parents=True)
    (folder / "mine" / "mixer" / "odd.yaml").write_text(text)
    ended = credit("train", "--config-dir", "mine", "mixer=odd")
    assert ended.code == 2
    for part in expected:
        assert part in ended.err
    assert [path.name for path in folder.iterdir()] == ["mine"]


def test_what_is_valid_is_listed_once_for_all_keys_of_a_place(credit) -> None:
    typed = ("train", "mixer.alfa=1", "mixer.epsilom=2", "mixer.x=3", "tile=a", "relica=2")
    lines = credit(*typed, "method=adaptive_mse").err.splitlines()
    for key in typed[1:]:
        assert any(key in line and "unknown key" in line for line in lines), key
    assert sum("(valid: alpha, epsilon)" in line for line in lines) == 1
    assert sum("(valid: agent" in line for line in lines) == 1
    assert any(line.endswith("did you mean 'alpha'?") for line in lines)
    assert not any(line.rstrip().endswith(";") for line in lines)
