"""`credit new`: the class, the YAML and the test of a component to start from, in a package that can be installed."""

from __future__ import annotations

import importlib.util
import keyword
import re
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from string import Template

from credit.cli.main import guarded
from credit.config import files
from credit.config.kinds import KINDS
from credit.core.errors import UserError, nearest

TEMPLATES = Path(__file__).parent / "templates"
TRY = {  # kind → the words that put an option to use
    "env": "env=$name",
    "feedback": "feedback=$name",
    "reward": "+reward@surrogates.$name=$name",
    "features": "method=reference reward@reference=linear features@reference.features=$name",
    "uncertainty": "uncertainty=$name",
    "mixer": "mixer=$name",
    "bonus": "'bonus=[count,$name]'",
    "assigner": "method=delayed assigner=$name",
    "transition": "transition=$name",
    "agent": "agent=$name",
    "encoder": "env=gymnasium env.id=Pendulum-v1 encoder=$name",
    "network": "env=gymnasium env.id=CartPole-v1 method=delayed +network@agent.network=$name",
    "scaler": "scaler=$name",
}
GROUP = "credit.components"
USAGE = "usage: credit new KIND NAME [--into FOLDER]"


def main(argv: list[str]) -> int:
    """Write a component to start from, and say how to try it."""
    if not argv or argv[0] in ("-h", "--help"):
        print(help_text())
        return 0
    kind, name, folder = read(argv)
    written = write(kind, name, folder)
    print("wrote")
    for path in written:
        print(f"  {path}")
    package = folder if folder.is_absolute() else Path(".") / folder
    words = Template(TRY[kind]).substitute(name=name)
    lines = ["try it", f"cd {package}", "pip install -e .", "pytest"]
    print(*lines, f"credit train {words}", sep="\n  ")
    return 0


def help_text() -> str:
    """Usage, and what each kind is."""
    width = max(map(len, TRY))
    return "\n".join(
        [
            USAGE,
            "",
            "writes the class, the YAML file and the test of a component to start from, in a package that credit finds",
            "once it is installed; in FOLDER (by default ./NAME), or beside what is there, if FOLDER is such a package",
            "",
            "kinds",
            *(f"  {kind:<{width}}  {KINDS[kind].help}" for kind in TRY),
        ]
    )


def read(argv: list[str]) -> tuple[str, str, Path]:
    """Kind, name and folder of a command line.

    Raises:
        UserError: there are too many words or too few, the kind is none, or the name cannot be taken.
    """
    words, folder = list(argv), None
    for word in argv:
        if word == "--into" or word.startswith("--into="):
            place = words.index(word)
            _, equals, folder = words.pop(place).partition("=")
            if not equals and place == len(words):
                raise UserError(f"--into needs a folder; {USAGE}")
            folder = folder if equals else words.pop(place)
            break
    if unknown := [word for word in words if word.startswith("-")]:
        raise UserError(f"{unknown[0]!r} is no option here; {nearest(unknown[0], ['--into', '--help'])}")
    if words and words[0] not in TRY:
        raise UserError(f"{words[0]!r} is no kind that can be written; {nearest(words[0], TRY)}")
    if len(words) != 2:
        given = " ".join(words)
        raise UserError(f"{given!r}: give a kind and a name, and nothing else; {USAGE}")
    kind, name = words
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise UserError(
            f"{name!r} is no name for a module: small letters, digits and _, a letter first, no word of Python"
        )
    if name in (known := files.options(kind)):
        raise UserError(f"{kind}={name} is registered already, in {known[name]}; choose another name")
    return kind, name, Path(folder or name)


def write(kind: str, name: str, folder: Path) -> list[Path]:
    """Write the files of a component, all or none.

    Args:
        kind: of the table of kinds. name: of the option. folder: of its package, which may be there already.

    Returns:
        The files.

    Raises:
        UserError: one is there already, or the folder holds something else than a package that credit finds.
    """
    project = folder / "pyproject.toml"
    package = announced(project) if project.exists() else name
    module = next((place for place in (folder / "src" / package, folder / package) if place.is_dir()), folder / package)
    values = {"kind": kind, "name": name, "package": package, "Class": name.title().replace("_", "")}
    texts = {
        module / f"{name}.py": filled(f"{kind}.py", values),
        module / "conf" / kind / f"{name}.yaml": filled(f"{kind}.yaml", values),
        folder / "tests" / f"test_{name}.py": filled("test.py", values),
    }
    if not project.exists():
        if importlib.util.find_spec(package) is not None:
            raise UserError(
                f"{package!r}: there is a module of this name, and a package would hide it; choose another name"
            )
        texts = {
            project: filled("pyproject.toml", values),
            module / "__init__.py": filled("package.py", values),
        } | texts
    if there := [str(path) for path in texts if path.exists()]:
        raise UserError(
            f"{', '.join(there)}: there already; nothing was written. Choose another name, or --into another folder"
        )
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return list(texts)


def filled(template: str, values: Mapping[str, str]) -> str:
    """A file of ours with names in it."""
    return Template((TEMPLATES / f"{template}.txt").read_text(encoding="utf-8")).substitute(values)


def announced(project: Path) -> str:
    """The package that a project announces to credit.

    Raises:
        UserError: it announces none, or its file is no TOML.
    """
    try:
        points = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["entry-points"][GROUP]
        return str(next(iter(points.values())))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{project}: no TOML ({error})") from None
    except (LookupError, AttributeError, TypeError, StopIteration):
        raise UserError(
            f"{project}: this project announces nothing to credit; add\n"
            f'[project.entry-points."{GROUP}"]\nPACKAGE = "PACKAGE"\nor choose another folder by --into'
        ) from None


if __name__ == "__main__":
    sys.exit(guarded("new", sys.argv[1:]))
