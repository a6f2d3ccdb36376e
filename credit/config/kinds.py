"""The table of kinds: which folders of `conf/` there are, what their files build, and what tells no two runs apart."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

# What may differ between two runs that are the same run.
CIRCUMSTANCES = (
    "seed",
    "replicas",
    "device",
    "output",
    "session",
    "slug",
    "rerun",
    "sweep",
    "tracking",
    "written_for",
    "checkpoint_rounds",
    "checkpoint_seconds",
    "keep",
)
STARTS = ("demonstrations_from", "policy_from")  # plain keys that are part of what a run is, where they are given


@dataclass(frozen=True)
class Kind:
    """A folder of `conf/`: the class its files build (`module:name`), the slots they fill, and one line of help.

    `several`: a slot holds several by name, so a file builds `SLOT.NAME` where it does not say its package.
    """

    base: str
    slots: tuple[str, ...]
    help: str
    several: bool = False

    def load(self) -> type:
        """The class itself; imported only when it is needed, so that `--help` stays fast."""
        module, name = self.base.split(":")
        found: type = getattr(importlib.import_module(module), name)
        return found


KINDS = {
    "env": Kind("credit.core.seams:Environment", ("env",), "where steps happen"),
    "feedback": Kind("credit.core.seams:Feedback", ("feedback",), "what a label is"),
    "reward": Kind(
        "credit.core.seams:RewardModel",
        ("reference", "surrogates"),
        "reward models: reward@reference=…, +reward@surrogates.NAME=…",
    ),
    "features": Kind("credit.core.seams:FeatureMap", (), "what a reward model looks at: features@reference.features=…"),
    "uncertainty": Kind("credit.core.seams:Uncertainty", ("uncertainty",), "how far a fit can be trusted"),
    "mixer": Kind("credit.core.seams:Mixer", ("mixer",), "MSE proxies → weights of the models"),
    "bonus": Kind(
        "credit.core.seams:Bonus", ("bonus",), "what optimism adds; several: bonus=[count,disagreement]", several=True
    ),
    "assigner": Kind("credit.core.seams:CreditAssigner", ("assigner",), "windows → one reward per step"),
    "transition": Kind("credit.core.seams:Transition", ("transition",), "P̂ for planning"),
    "agent": Kind("credit.core.seams:Agent", ("agent",), "relabelled rewards → policy"),
    "network": Kind("credit.networks.modules:Network", (), "networks of one's own: +network@agent.network=…"),
    "encoder": Kind("credit.core.seams:Encoder", ("encoder",), "how an agent's networks see a state that is a vector"),
    "scaler": Kind("credit.core.seams:Scaler", ("scaler",), "how a pseudo-reward is scaled and clipped"),
    "tracking": Kind("credit.tracking:Tracking", ("tracking",), "where runs are mirrored"),
}
SLOTS = {slot: kind for kind, entry in KINDS.items() for slot in entry.slots}  # slot → its kind
CHOICES = {  # folders that choose among the kinds, and build nothing themselves
    "method": "a credit assigner and an agent, by the name it has in tables",
    "experiment": "an environment, its feedback, models and horizon",
    "sweep": "the jobs of a table or figure, by one word: credit train -m sweep=…",
}
