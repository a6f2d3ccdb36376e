"""`import credit` registers our Gymnasium ids, in any order of imports, and imports nothing heavy for it."""

from __future__ import annotations

import subprocess
import sys

import pytest

KNOWN = "assert {'credit/Advertiser-v0', 'credit/Sepsis-v0'} <= {*gymnasium.registry}; "
LIGHT = "assert not {'torch', 'torchrl', 'mujoco', 'hydra', 'mlflow'} & {*sys.modules}, 'heavy'; "


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", f"import sys; {code}"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize(
    "imports",
    [
        "import credit; import gymnasium; ",
        "import gymnasium; import credit; ",
        "import credit; from gymnasium.envs.registration import make; import gymnasium; ",
        "import credit.envs; import gymnasium; import credit; ",
        "import credit, importlib.util; importlib.util.find_spec('gymnasium'); import gymnasium; ",
    ],
)
def test_credit_alone_registers_without_torch(imports: str) -> None:
    assert python(imports + KNOWN + LIGHT) == ""


def test_credit_alone_imports_neither_gymnasium_nor_numpy() -> None:
    python("import credit; assert not {'gymnasium', 'numpy', 'torch'} & {*sys.modules}")


def test_the_waiting_is_over_once_gymnasium_is_there() -> None:
    waiting = "[finder for finder in sys.meta_path if type(finder).__module__ == 'credit.envs.registration']"
    python(f"import credit; assert {waiting}; import gymnasium; assert not {waiting}; import importlib; "
           "importlib.reload(gymnasium); assert 'credit/Sepsis-v0' in gymnasium.registry")  # fmt: skip


def test_a_machine_without_gymnasium_says_so_itself() -> None:
    hidden = "class Hidden:\n    def find_spec(self, name, path=None, target=None):\n        if name == 'gymnasium': "
    hidden += "raise ModuleNotFoundError('No module named gymnasium', name=name)\n"
    code = f"exec({hidden!r}); sys.meta_path.insert(0, Hidden()); import credit\ntry: import gymnasium\n"
    python(code + "except ModuleNotFoundError as error: assert error.name == 'gymnasium'\nelse: raise SystemExit(1)")


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["credit:credit/Sepsis-v0", "credit.envs:credit/Advertiser-v0"])
def test_an_environment_is_made_by_its_id_alone(name: str) -> None:
    code = f"import gymnasium; env = gymnasium.make({name!r}); state, _ = env.reset(seed=0); print(int(state))"
    assert python(code).strip().isdigit()
