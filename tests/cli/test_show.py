"""`credit show`, `--cfg` and completion: what there is to type, and what it means."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from credit.cli.completion import SCRIPTS, candidates
from credit.config import files
from credit.config.kinds import CHOICES, KINDS


def test_a_method_is_shown_by_its_parts_and_by_what_it_changes(credit) -> None:
    said = credit("show", "experiment=sepsis", "method=reference")
    assert said.code == 0
    assert "ReferenceOnly: All weight on the reference model" in said.out
    assert "mixer = reference_only   (relative_mse)" in said.out
    assert "bonus.local_mse.scale = 0.1   (–)" in said.out
    assert "env = sepsis   (advertiser)" in said.out  # of the experiment's own section
    assert "nothing: it is the default" in credit("show", "method=disagreement").out


def test_a_part_is_shown_by_its_docstring_and_its_keys(credit) -> None:
    said = credit("show", "bonus=count").out
    assert "conf/bonus/count.yaml" in said
    assert "The count bonus c/√(λ + N(s, a)) of (17) and (19)." in said
    assert "lambda_visits = 1.0   (float > 0)" in said


@pytest.mark.parametrize("words", [("show", "method=disagreement"), ("list", "feedback")])
def test_pages_are_as_wide_as_the_terminal(credit, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert max(map(len, credit(*words).out.splitlines())) > 80  # a pipe has no width
    monkeypatch.setattr("credit.cli.output.Surviving.isatty", lambda stream: True, raising=False)
    assert max(map(len, credit(*words).out.splitlines())) <= 80


@pytest.mark.parametrize("kind", [*CHOICES, *KINDS])
def test_everything_that_is_registered_can_be_shown(credit, kind: str) -> None:
    option = next(iter(files.options(kind)))
    ended = credit("show", f"{kind}={option}")
    assert ended.code == 0, ended.err
    assert ended.out.startswith(f"{kind}={option}   ")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("metod=reference",), "did you mean 'method'"),
        (("method=refernce",), "did you mean 'reference'"),
        (("method=dqn",), "dqn is an option of agent, write agent=dqn"),
        (("method",), "KIND=OPTION is needed"),
        ((), "KIND=OPTION is needed"),
    ],
)
def test_what_is_not_there_is_not_shown(credit, words: tuple[str, ...], said: str) -> None:
    ended = credit("show", *words)
    assert ended.code == 2
    assert said in ended.err


@pytest.mark.parametrize("command", ["train", "check"])
def test_hydras_cfg_prints_the_job_and_runs_nothing(credit, folder: Path, command: str) -> None:
    ended = credit(command, "--cfg", "job", "method=reference", "trainer.steps=70")
    assert ended.code == 0
    assert yaml.safe_load(ended.out)["trainer"]["steps"] == 70
    assert not (folder / "outputs").exists()
    assert set(yaml.safe_load(credit(command, "-c", "hydra").out)) == {"hydra"}
    assert {"hydra", "trainer"} <= set(yaml.safe_load(credit(command, "--cfg=all").out))
    for words in (("--cfg", "jbo"), ("--cfg",), ("-m", "--cfg", "job", "seed=1,2")):
        assert credit(command, *words).code == 2


@pytest.mark.parametrize(
    ("typed", "found"),
    [
        ("tr", ["train"]),
        ("train me", ["method="]),
        ("train method=re", ["method=reference"]),
        ("train bonus=[count,el", ["bonus=[count,elliptical"]),
        ("train bonus=count bonus.", ["bonus.count.lambda_visits=", "bonus.count.scale="]),
        ("train +reward@surrogates.mine=dn", ["+reward@surrogates.mine=dnn"]),
        ("train trainer.st", ["trainer.steps="]),
        ("list bo", ["bonus"]),
        ("show experiment=adv", ["experiment=advertiser"]),
        ("status o", ["output="]),
        ("tune tri", ["trials="]),
        ("tune method=orac", ["method=oracle"]),
        ("nonsense ", []),
    ],
)
def test_words_are_completed(typed: str, found: list[str]) -> None:
    assert candidates(typed.split(" ")) == found


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_bash_completes_behind_the_equals_sign_at_which_it_breaks_words(tmp_path: Path) -> None:
    typed = 'COMP_LINE="credit train method=re"\nCOMP_POINT=${#COMP_LINE}\n_credit\necho "${COMPREPLY[*]}"'
    script = f"{SCRIPTS['bash']}\n{typed}"
    (tmp_path / "credit").write_text(f'#!/bin/sh\nexec {sys.executable} -m credit "$@"\n')
    (tmp_path / "credit").chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(["bash", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "reference\n"


def test_a_shell_gets_its_script(credit) -> None:
    for shell, script in SCRIPTS.items():
        assert credit("completion", shell).out == f"{script}\n"
    assert credit("completion", "tcsh").code == 2
