"""The words of `credit recover`: what they ask for, each of several recoveries apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, fields
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from credit.cli.recovery_data import is_csv, is_run, name_of, pattern_of
from credit.cli.recovery_model import without_effect
from credit.cli.recovery_parts import WORDS as MODELS
from credit.cli.recovery_parts import models_of
from credit.cli.recovery_place import over
from credit.config import files, registry
from credit.core.errors import UserError, nearest
from credit.core.naming import is_name
from credit.logged.asking import REFERENCE, Ask
from credit.logged.recovered import Options
from credit.logged.tables.words import Words

if TYPE_CHECKING:
    pass

SINGLE = ("window", "label", "labels", "time", "group", "propensity")  # words of data that name one thing
OWN = ("output", "name", "format", "tracking", "from")  # of this command alone
TEXTS = (REFERENCE, "from", "output", "name", *(f"data.{one}" for one in SINGLE))  # taken as they are typed
FORMATS, TRACKING = ("csv", "parquet"), ("mlflow", "none")
FLAGS = ("-m", "--multirun", "--explain")
MODEL = "--model"
PATHS = ("--config-dir", "-cd", MODEL)  # take a word
Tree = dict[str, Any]


@dataclass(frozen=True)
class Request:
    """One recovery.

    Attributes:
        data: the table. words: as they were typed. ask: what is asked. explain: fit nothing.
        output, name: the folder is OUTPUT/recover/NAME. format: of steps. tracked: whether it is logged to MLflow.
        model: the folder of a model that scores the rows; None: they are fitted. launcher: words that choose what runs
            passes over the table's files as jobs; none: this process. config_dirs: further folders of YAML files.
        tree: keys that were typed, as nested mappings, and those that were guessed, once the table was seen. named:
            whether the name was typed.
    """

    data: str
    words: tuple[str, ...]
    ask: Ask
    explain: bool
    output: Path
    name: str
    format: str
    tracked: bool
    model: Path | None = None
    launcher: tuple[str, ...] = ()
    config_dirs: tuple[str, ...] = ()
    tree: Mapping[str, Any] = field(default_factory=dict)
    named: bool = False

    @property
    def folder(self) -> Path:
        """Where it goes."""
        return self.output / "recover" / self.name


def requests(argv: Sequence[str]) -> list[Request]:
    """What a command line asks for: one recovery, or with -m one for each of several values.

    Raises:
        UserError: with all words that are wrong.
    """
    flags, paths, words = _sorted(argv)
    data = [word for word in words if "=" not in word or Path(word).exists()]
    keys = [word for word in words if word not in data]
    if len(data) != 1:
        shown = ", ".join(map(repr, data)) or "none"
        raise UserError(f"one table is needed, got {shown}; `credit recover --help` says more")
    several = bool({"-m", "--multirun"} & {*flags})
    every = [*_each(keys)] if several else [keys]
    found = [_request(data[0], one, flags, paths) for one in every]
    if several and len(found) > 1:
        found = [_named(one, every, number) for number, one in enumerate(found)]
    return found


def _sorted(argv: Sequence[str]) -> tuple[list[str], list[tuple[str, str]], list[str]]:
    """Flags, options with their folders, and all other words."""
    flags, folders, words, rest = list[str](), list[tuple[str, str]](), list[str](), list(argv)
    while rest:
        word = rest.pop(0)
        name, equals, value = word.partition("=")
        if word in FLAGS:
            flags.append(word)
        elif name in PATHS:
            if not equals and not rest:
                raise UserError(f"{name} needs a folder")
            folders.append((name, value if equals else rest.pop(0)))
        elif word.startswith("-") and not word.startswith("--=") and not Path(word).exists():
            raise UserError(f"{word!r} is no option here; {nearest(word, [*FLAGS, *PATHS])}; settings are key=value")
        else:
            words.append(word)
    if len([name for name, _ in folders if name == MODEL]) > 1:
        raise UserError(f"{MODEL} is given twice; leave one of them out")
    return flags, folders, words


def _each(words: Sequence[str]) -> Iterator[list[str]]:
    """The words of each of several recoveries: all values of all words with each other."""
    choices = [[f"{key}={value}" for value in _values(key, text)] for key, _, text in (w.partition("=") for w in words)]
    for one in product(*choices):
        yield list(one)


def _values(key: str, text: str) -> list[str]:
    """Values with commas between them; those within brackets and quotes are one."""
    found, depth, quote, begin = list[str](), 0, "", 0
    for at, letter in enumerate(text):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "'\"":
            quote = letter
        elif letter in "([{":
            depth += 1
        elif letter in ")]}":
            depth -= 1
        elif letter == "," and not depth:
            found.append(text[begin:at])
            begin = at + 1
    found = [*found, text[begin:]]
    if not all(value.strip() for value in found) and len(found) > 1:
        raise UserError(f"{key}={text}: there is nothing between two commas; leave one out")
    return found


def _named(one: Request, every: Sequence[Sequence[str]], number: int) -> Request:
    """The same, in a folder named by what differs."""
    from dataclasses import replace

    shared = set.intersection(*(set(words) for words in every))
    slug = ",".join(word for word in every[number] if word not in shared)
    safe = "".join(letter if letter.isalnum() or letter in "=.,_-" else "-" for letter in slug)[:120]
    base = one.name if one.named else f"{one.name}-sweep"
    return replace(one, name=f"{base}/{number:02d}-{safe}")


def _request(data: str, words: Sequence[str], flags: Sequence[str], paths: Sequence[tuple[str, str]]) -> Request:
    config_dirs = [path for name, path in paths if name != MODEL]
    model = next((Path(path) for name, path in paths if name == MODEL), None)
    launcher = tuple(word for word in words if word.lstrip("+").startswith("hydra"))
    tree = _tree([word for word in words if word not in launcher])
    if (file := tree.pop("from", None)) is not None:
        tree = over(_file(file), tree)
    problems: list[str] = []
    own = {key: tree.pop(key) for key in OWN if key in tree}
    typed = deepcopy(tree)
    known = [*OWN, "mixer", "data", REFERENCE, "surrogates", *MODELS, *(one.name for one in fields(Options))]
    problems += [f"unknown key {key!r}; {nearest(key, known)}" for key in tree if key not in known]
    if model is not None and launcher:
        problems.append(f"{launcher[0]} has no effect: rows are scored in this process; leave it out")
    if model is not None:
        problems += without_effect([*tree], config_dirs)
    for key, allowed in (("format", FORMATS), ("tracking", TRACKING)):
        if key in own and own[key] not in allowed:
            problems.append(f"{key}={own[key]}: {nearest(str(own[key]), allowed)}")
    name = str(own.get("name", _stem(data)))
    if not all(is_name(part) for part in name.split("/")):
        problems.append(f"name={name}: {name!r} is no name; {is_name.__doc__}")
    try:
        models = models_of(tree, config_dirs)
        plain = {key: value for key, value in tree.items() if key in known and key not in ("mixer", *MODELS)}
        draws = {} if models.draws is None or "draws" in plain else {"draws": models.draws}
        given = {**plain, **draws, REFERENCE: models.reference, "surrogates": models.surrogates}
        ask = Ask.of(given, models.mixer)
        Words.of(ask.data)
    except UserError as error:
        problems += str(error).splitlines()
    if problems:
        raise UserError("\n".join([*problems, "`credit recover --help` lists what can be set"]))
    format_ = own.get("format", "csv" if is_csv(data) else "parquet")
    output = Path(str(own.get("output", "outputs")))
    return Request(
        data, tuple(words), ask, "--explain" in flags, output, name, format_, own.get("tracking") != "none", model,
        launcher, tuple(config_dirs), typed, "name" in own,
    )  # fmt: skip


def _stem(data: str) -> str:
    """A name for the folder of a table's recovery."""
    stem = name_of(data) if is_run(data) else pattern_of(data) or "data"
    stem = (
        "".join(letter if letter.isalnum() or letter in "_-." else "-" for letter in stem)
        .strip("-.")[-90:]
        .lstrip("-.")
        or "data"
    )
    return stem if is_name(stem) else f"data-{stem}"


def _tree(words: Sequence[str]) -> Tree:
    """Words as nested mappings.

    Raises:
        UserError: a word that is none, or a key that is given twice.
    """
    tree: Tree = {}
    problems = []
    for word in words:
        key, _, text = word.partition("=")
        path = key.split(".")
        if not all(path):
            problems.append(f"{word!r}: {key!r} is no key; write data.window=week, draws=100")
            continue
        try:
            value = _value(key, text)
        except UserError as error:
            problems.append(str(error))
            continue
        node = tree
        for part in path[:-1]:
            inner = node.setdefault(part, {})
            if not isinstance(inner, dict):  # mixer=best mixer.alpha=1
                inner = node[part] = {"": inner}
            node = inner
        if path[-1] in node and not isinstance(node[path[-1]], dict):
            problems.append(f"{key} is given twice; leave one of them out")
        elif isinstance(node.get(path[-1]), dict) and not isinstance(value, dict):
            node[path[-1]][""] = value
        else:
            node[path[-1]] = value
    if problems:
        raise UserError("\n".join(problems))
    return tree


def _value(key: str, text: str) -> Any:
    """A value as Hydra reads it; formulas and names of columns are texts."""
    raw = text.strip()
    if key.endswith(".formula") or key in TEXTS:
        return raw[1:-1] if len(raw) > 1 and raw[0] == raw[-1] and raw[0] in "'\"" else raw
    override = registry.parse(f"key={text}")
    if override.is_sweep_override():
        raise UserError(f"{key}={text}: several values are several recoveries; add -m, or write a list, [a, b]")
    return _plain(override.value())


def _plain(value: Any) -> Any:
    """Hydra's quoted strings as texts."""
    if isinstance(value, Mapping):
        return {str(getattr(key, "text", key)): _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return getattr(value, "text", value)


def _file(file: Any) -> Tree:
    path = Path(str(file))
    if not path.is_file():
        raise UserError(f"from={file}: there is no such file")
    found = files.read(path)
    return dict(found)
