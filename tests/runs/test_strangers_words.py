"""What a stranger types for an environment that has no experiment of its own, word for word as the pages have it."""

from __future__ import annotations

from typing import Any

import pytest

from credit.config import registry, schema
from credit.config.identity import identity
from credit.recovery.uncertainty.bootstrap import Analytic, Bootstrap
from credit.runs import job

PENDULUM = ("env=gymnasium", "env.id=Pendulum-v1", "tracking=none")
CARTPOLE = ("env=gymnasium", "env.id=CartPole-v1", "tracking=none")
FORMULA = ("method=disagreement", "+reward@surrogates.mine=formula")
TERMS = {
    "vectors": 'surrogates.mine.features.formula="1 + s0 + a0"',
    "numbers": 'surrogates.mine.features.formula="1 + s2 + C(a)"',
}
CELLS = ("method=disagreement", "+reward@surrogates.mine=cells", "surrogates.mine.features.cells={0: 4}")
NO_ACTIONS, BOUNDS = "surrogates.mine.features.actions=false", "surrogates.mine.features.bounds={0: [-1, 1]}"
OWN = "+uncertainty@surrogates.mine.uncertainty=residual"


def composed(*words: str) -> dict[str, Any]:
    return registry.compose(words)


@pytest.mark.parametrize(
    "words",
    [
        pytest.param((*PENDULUM, *FORMULA, TERMS["vectors"]), id="sac, formula"),
        pytest.param((*PENDULUM, *CELLS, NO_ACTIONS), id="sac, cells"),
        pytest.param((*CARTPOLE, *FORMULA, TERMS["numbers"]), id="dqn, formula"),
        pytest.param((*CARTPOLE, *CELLS), id="dqn, cells"),
        pytest.param((*CARTPOLE, *CELLS, "uncertainty=ensemble"), id="with draws"),
        pytest.param(("experiment=pointmaze", *CELLS, NO_ACTIONS, BOUNDS, "tracking=none"), id="maze"),
    ],
)
def test_a_surrogate_without_python_brings_an_uncertainty_beside_networks(words: tuple[str, ...]) -> None:
    config = composed(*words)
    assert job.check(config).problems == []
    mine = schema.build(config, "trainer").assigner.surrogates["mine"]
    assert isinstance(mine.uncertainty, Analytic)
    assert mine.uncertainty.noise is None
    own = composed(*words, OWN)  # as before, and another run
    assert job.check(own).problems == []
    assert identity(own) != identity(config)


def test_where_the_uncertainty_is_for_linear_models_they_share_it() -> None:
    config = composed(*FORMULA, 'surrogates.mine.features.formula="1 + s"', "tracking=none")
    assert job.check(config).problems == []
    assigner = schema.build(config, "trainer").assigner
    assert isinstance(assigner.surrogates["mine"].uncertainty, Bootstrap)
    assert assigner.surrogates["mine"].uncertainty is assigner.reference.uncertainty


def test_an_uncertainty_that_nobody_takes_is_no_choice() -> None:
    found = job.check(composed("method=reference", "uncertainty=dropout", "tracking=none")).problems
    assert len(found) == 1
    assert "reference: LinearModel needs a FitUncertainty in uncertainty, and there is Dropout" in found[0]


@pytest.mark.parametrize("agent", ["sac", "sac_plain", "sac_tuned", "sac_plain_tuned"])
@pytest.mark.parametrize("method", ["reference", "delayed"])
def test_every_soft_actor_critic_fits(agent: str, method: str) -> None:
    config = composed(*PENDULUM, f"method={method}", f"agent={agent}")
    assert job.check(config).problems == []
    keys = config["agent"]
    assert (keys["n_step"], keys["success_share"], keys["update_ratio"], keys["width"]) == (1, 0.0, 1.0, 128)


def test_recipes_differ_by_what_they_are() -> None:
    stable, plain = (composed(*PENDULUM, "method=reference", f"agent={name}")["agent"] for name in ("sac", "sac_plain"))
    differ = {key for key in stable if stable[key] != plain[key]}
    assert differ == {"layer_norm", "batch", "policy_delay", "target_clip", "updates", "first_updates"}
    maze = composed("experiment=pointmaze", "method=reference")["agent"]
    assert (maze["n_step"], maze["success_share"], maze["update_ratio"]) == (30, 0.5, 0.0)
