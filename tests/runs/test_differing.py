"""What tells the jobs of a command apart."""

from __future__ import annotations

from typing import Any

from credit.runs.differing import labels, name, parameters


def config(method: str = "disagreement", alpha: float = 0.5, scale: float = 0.2, **more: Any) -> dict[str, Any]:
    count = {"_target_": "credit.recovery.bonuses.Count", "scale": scale}
    mixer = {"_target_": "credit.recovery.mixers.RelativeMSE", "alpha": alpha}
    own = {"title": method.upper(), "seed": 0, "replicas": 2, "output": "outputs", "policy_from": None, "keep": []}
    return {"method": method, "experiment": "advertiser", "bonus": {"count": count}, "mixer": mixer, **own, **more}


def names(*configs: dict[str, Any]) -> list[str]:
    found = labels(configs)
    return [name(label, found) for label in found]


def test_parameters_have_registered_names_and_no_circumstances() -> None:
    assert parameters(config()) == {
        "method": "disagreement",
        "experiment": "advertiser",
        "bonus.count": "count",
        "bonus.count.scale": 0.2,
        "mixer": "relative_mse",
        "mixer.alpha": 0.5,
    }


def test_a_name_says_what_differs_and_nothing_else() -> None:
    jobs = [config(alpha=alpha, scale=scale) for alpha in (0.1, 0.3) for scale in (0.2, 0.35)]
    assert names(*jobs) == [
        "scale=.2 alpha=.1",
        "scale=.35 alpha=.1",
        "scale=.2 alpha=.3",
        "scale=.35 alpha=.3",
    ]


def test_methods_alone_are_their_names() -> None:
    assert names(config("reference"), config("delayed", agent={"discount": 1.0})) == ["reference", "delayed"]


def test_a_method_of_one_job_says_nothing_of_what_others_vary() -> None:
    assert names(config("reference"), config(alpha=0.1), config(alpha=0.3)) == [
        "reference",
        "alpha=.1 disagreement",
        "alpha=.3 disagreement",
    ]


def test_keys_of_one_end_keep_what_tells_them_apart() -> None:
    found = labels([config(scale=0.1, env={"scale": 1}), config(scale=0.2, env={"scale": 2})])
    assert name(found[0], found) == "count.scale=.1 env.scale=1"


def test_a_job_alone_differs_from_nothing_and_seeds_tell_apart() -> None:
    assert labels([config()]) == [{}]
    assert names(config(), config(seed=2)) == ["seed=0", "seed=2"]
