"""What one job is: its plain keys, its identity, its folders, and what of it is already done."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import torch
import yaml

from credit.config import classes, fitting, schema
from credit.config.identity import identity, namesakes
from credit.config.kinds import CIRCUMSTANCES, KINDS
from credit.core.capabilities import parts_of
from credit.core.errors import Misfit, UserError
from credit.core.ranges import Line, Name, NonNegative, NonNegativeInt, PositiveInt
from credit.renamed import translated
from credit.runs import rehearsal, starting
from credit.trainer import Trainer


@dataclass(frozen=True)
class Job:
    """The plain keys of a configuration; the check derives their schema from these fields.

    Attributes:
        experiment: name of the experiment. method: name of the method. title: its name in tables.
        seed: first seed. replicas: seeds side by side. device: cpu, cuda, cuda:<n> or auto.
        checkpoint_rounds: rounds between two checkpoints, at least. checkpoint_seconds: and seconds.
        output: folder of all runs. rerun: compute again what is done. session: id of the `credit train`.
        slug: name of the folder of its runs, by what differs from the method.
        demonstrations_from: steps that every replica is given before its first round: a file, a run's folder, or a
            Minari dataset. policy_from: the folder of a run whose agent every seed goes on from.
        keep: what its folders hold beyond figures: its steps, its agents to go on from.
        sweep: what becomes of a sweep's other jobs. written_for: the only experiment of a method, where it has one.
    """

    experiment: Name
    method: Name
    title: Line
    seed: NonNegativeInt = 0
    replicas: PositiveInt = 1
    device: str = "cpu"
    checkpoint_rounds: PositiveInt = 1
    checkpoint_seconds: NonNegative = 60.0
    output: str = "outputs"
    rerun: bool = False
    session: str | None = None
    slug: str | None = None
    demonstrations_from: str | None = None
    policy_from: str | None = None
    keep: list[Literal["steps", "agent"]] = field(default_factory=list)
    sweep: dict[Literal["on_error"], Literal["continue", "stop"]] = field(default_factory=dict)
    written_for: str | None = None

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Job:
        """The job of a checked configuration."""
        return cls(**{field.name: config[field.name] for field in fields(cls) if field.name in config})

    @property
    def seeds(self) -> tuple[int, ...]:
        """seed … seed + replicas − 1."""
        return tuple(range(self.seed, self.seed + self.replicas))

    @property
    def folder(self) -> Path:
        """The output folder, absolute."""
        return Path(self.output).resolve()

    @property
    def parent(self) -> Path:
        """The folder of its runs."""
        return self.folder / self.experiment / self.method / (self.slug or "default")


def check(config: Mapping[str, Any]) -> schema.Check:
    """Every problem of a composed configuration: keys, types, ranges, fit, device, folder, tracking URI."""
    found = schema_of(config)
    if not found.problems:
        found.problems += _device_problems(str(config["device"])) + _folder_problems(Path(config["output"]))
        found.problems += schema.build(config, "tracking").check(Path(config["output"]).resolve())
    if not found.problems:
        try:
            trainer = schema.build(config, "trainer")
            found.problems += rehearsal.problems(config, trainer)
            if not found.problems:
                # a policy is one of as many seeds as the run has
                trainer.start(Job.of(config).seeds if config.get("policy_from") else (config["seed"],))
                starting.given(config, trainer)
                starting.inherited(config, trainer)
                remarks = [part.remark() for _, part in parts_of(trainer)]
                found.remark = "; ".join(filter(None, [*remarks, _dying_pays(trainer)]))
        except Misfit as error:
            found.problems += fitting.said(error, trainer.problem, trainer.env.knowledge())
        except UserError as error:
            found.problems.append(str(error))
    return found


def _dying_pays(trainer: Trainer) -> str:
    """What to say where no reward is above zero, and an episode may end before its time; else nothing."""
    scaler = getattr(trainer.assigner, "scaler", None)
    if scaler is None or scaler.cap is None or scaler.cap > 0 or not trainer.env.ends_early:
        return ""
    if "success" in (trainer.feedback.reads, trainer.feedback.objective):  # an episode that ends early has succeeded
        return ""
    return (
        f"{type(scaler).__name__} leaves no reward above {scaler.cap:g}, and episodes of {type(trainer.env).__name__} "
        "may end early: to end one soon then pays, also by failing; take a scaler without a cap, such as scaler=unit "
        "(or scaler.quantile=null)"
    )


def schema_of(config: Mapping[str, Any]) -> schema.Check:
    """What signatures say of a composed configuration: keys, types, ranges, and which slots it uses."""
    found = schema.Check({}, {}, Job, ())
    trainer = classes.resolve("trainer", config["trainer"]) if classes.is_component(config.get("trainer")) else None
    if trainer is None:
        found.problems = ["trainer: the node is missing or has no _target_"]
    elif config.get("written_for") not in (None, config.get("experiment")):
        found.problems = [
            f"method={config.get('method')} is written for experiment={config['written_for']} only, and the experiment "
            f"is {config.get('experiment')}; choose another method (see `credit list`), or that experiment"
        ]
    else:
        slots = {slot: kind.load() for kind in KINDS.values() for slot in kind.slots}
        found = schema.Check(config, {**slots, "trainer": trainer}, Job, ("trainer", "tracking"))
    return found


def checked(config: Mapping[str, Any], say: Callable[[str], None] = lambda remark: None) -> dict[str, Any]:
    """The configuration, without the slots that it does not use.

    Args:
        say: called with what is right, but a user should know.

    Raises:
        UserError: with all problems.
    """
    found = check(config)
    if found.remark:
        say(found.remark)
    if found.problems:
        raise UserError("\n".join(found.problems))
    names = {field.name for field in fields(Job)}
    return {key: value for key, value in config.items() if key in found.used or key in names}


def plan(config: Mapping[str, Any]) -> dict[str, Any]:
    """What tells a job from others: its configuration, its folder and its seeds."""
    job = Job.of(config)
    named = {"experiment": job.experiment, "method": job.method, "slug": job.slug}
    return named | {"seed": job.seed, "replicas": job.replicas, "config_hash": identity(config)}


def split(config: Mapping[str, Any], parent: Path) -> tuple[list[int], list[int]]:
    """The seeds that are still to be computed, and those that are done, in a job's folder.

    Raises:
        UserError: a folder holds a run of another configuration, which is never overwritten (but see `rerun`).
    """
    todo: list[int] = []
    done: list[int] = []
    asked = [parent / f"seed-{seed}" for seed in Job.of(config).seeds]
    replaced, right = asked if config["rerun"] else [], set[bytes]()
    for file in sorted(parent.glob("seed-*/config.yaml")):
        if file.parent in replaced or (text := file.read_bytes()) in right:
            continue
        earlier = read(file.parent)
        if identity(earlier) != identity(config):
            raise UserError(
                f"{file.parent} holds a run of another configuration: {'; '.join(differences(earlier, config))}. "
                "Nothing was overwritten. Use another output=…, or rerun=true with all seeds there to replace them"
            )
        if twins := next(namesakes(earlier, config), None):
            raise UserError(
                f"{file.parent} holds a run of {twins[0]}, and this is one of {twins[1]}: two classes of one name and "
                "package are one part to a run's identity; rename one of them. Nothing was overwritten"
            )
        right.add(text)
    for seed, folder in zip(Job.of(config).seeds, asked, strict=True):
        (done if folder not in replaced and (folder / "DONE").exists() else todo).append(seed)
    return todo, done


def read(folder: Path) -> dict[str, Any]:
    """The configuration of a run, in today's names.

    Raises:
        UserError: its file is damaged, or missing.
    """
    path = folder / "config.yaml"
    try:
        found = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError, UnicodeDecodeError):
        found = None
    if not isinstance(found, dict):
        state = "damaged" if path.exists() else "missing"
        raise UserError(f"{path}: {state}; restore it, or move {folder} away and compute the run anew")
    return translated(found)


def differences(earlier: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """`key: old → new` for every key that decides results and differs."""
    first, second = (dict(_flat({k: v for k, v in c.items() if k not in CIRCUMSTANCES})) for c in (earlier, now))
    keys = sorted(set(first) | set(second))
    return [f"{key}: {first.get(key)} → {second.get(key)}" for key in keys if first.get(key) != second.get(key)]


def device(name: str, number: int = 0) -> torch.device:
    """The device that a name means here; `auto` is cuda where there is one. Jobs take turns at the visible GPUs.

    Args:
        name: cpu, cuda, cuda:<n> or auto. number: of the job in its sweep.
    """
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and torch.cuda.device_count():
        name = f"cuda:{number % torch.cuda.device_count()}"
    return torch.device(name)


def _device_problems(name: str) -> list[str]:
    allowed = "allowed: cpu, cuda, cuda:<n>, auto"
    try:
        chosen = device(name)
    except RuntimeError:
        return [f"device={name!r}: no such device; {allowed}"]
    if chosen.type == "cuda" and (chosen.index or 0) >= torch.cuda.device_count():
        return [f"device={name!r}: {torch.cuda.device_count()} CUDA devices are visible; {allowed}"]
    return [] if chosen.type in ("cpu", "cuda") else [f"device={name!r}: not supported; {allowed}"]


def _folder_problems(output: Path) -> list[str]:
    """Whether the output folder can be written, or made; found out without making it."""
    existing = output.resolve()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        return [f"output={str(output)!r}: {existing} is a file; give a folder"]
    try:
        tempfile.TemporaryFile(dir=existing).close()  # permissions alone do not tell, least of all for root
    except OSError as error:
        return [f"output={str(output)!r}: {existing} is not writable ({error.strerror}); give another folder"]
    return []


def _flat(value: Any, prefix: str = "") -> Sequence[tuple[str, Any]]:
    if not isinstance(value, Mapping):
        return [(prefix, value)]
    pairs: list[tuple[str, Any]] = []
    for key, inner in value.items():
        pairs += _flat(inner, f"{prefix}.{key}" if prefix else str(key))
    return pairs
