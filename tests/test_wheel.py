"""A wheel holds one package, works outside the checkout, and nothing advises to install a stranger's."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import credit

ROOT = Path(__file__).resolve().parents[1]
# `credit` on the package index is somebody else's: an extra of it, or its name behind `install`
EXTRAS = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]["optional-dependencies"]
STRANGER = re.compile(
    rf"(?<![\w.-])credit\\?\[(?:{'|'.join(EXTRAS)}|{{)"  # not an array that is called credit
    r"|\b(?:pip3?|pipx|uv|poetry|conda)\b[^\n#]*\b(?:install|add)\b[^\n#]*[\s'\"]credit(?:[=<>~]=?[\d'\"]|['\"`\s]|$)",
    re.M,
)
PLACES = ("credit", "conf", "launch", "examples", "docs", "tests", ".ci")


@pytest.mark.thorough
def test_the_wheel_trains_outside_the_checkout(tmp_path):
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        wheel.extractall(tmp_path / "site")
    assert (tmp_path / "site/credit/conf/config.yaml").exists()
    assert (tmp_path / "site/credit/py.typed").exists()
    assert {"page.html", "page.css"} <= {path.name for path in (tmp_path / "site/credit/logged/report").iterdir()}
    metadata = f"credit_rl-{credit.__version__}.dist-info"
    assert {path.name for path in (tmp_path / "site").iterdir()} == {"credit", metadata}
    assert "\nName: credit-rl\n" in (tmp_path / "site" / metadata / "METADATA").read_text(encoding="utf-8")
    code = (
        "import credit, sys; from credit.cli.main import main; assert 'site' in credit.__file__; "
        "sys.exit(main(['train', 'method=random', 'replicas=1', 'trainer.steps=70', 'tracking=none']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": str(tmp_path / "site")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "outputs/advertiser/random/trainer.steps=70/seed-0/DONE").exists()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("pip install 'credit[video]'", True),
        ("pip install\n'credit[minari]'", True),
        ("pip install credit", True),
        ("uv add credit\n", True),
        ('pip install -U "credit>=0.1"', True),
        ('"credit[slurm]", "credit[ray]"', True),
        ("pip install 'credit-rl[video]'", False),
        ("pip install -e '.[server]'", False),
        ("install -d -o credit /srv/credit", False),
        ("an index of credit: pip install torch", False),
    ],
)
def test_what_counts_as_advice(text: str, found: bool) -> None:
    assert bool(STRANGER.search(text)) == found


def test_nothing_advises_to_install_a_stranger() -> None:
    files = [
        path for path in ROOT.iterdir() if path.suffix in (".md", ".toml", ".txt", ".cff") or path.name == "Makefile"
    ]
    files += [path for place in PLACES for path in (ROOT / place).rglob("*") if path.is_file()]
    texts = [path for path in files if path.suffix not in (".png", ".svg", ".pyc") and path != Path(__file__).resolve()]
    assert len(texts) > 200
    bad = [
        f"{path.relative_to(ROOT)}: {found.group()}"
        for path in texts
        for found in STRANGER.finditer(path.read_text(encoding="utf-8", errors="ignore"))
    ]
    assert not bad
