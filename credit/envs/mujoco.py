"""What MuJoCo warns of: said once, not once an environment, and not written into the user's folder."""

from __future__ import annotations

import sys

_said = set[str]()


def warn_once() -> None:
    """Let MuJoCo say each warning once a process, on the error stream, and write no `MUJOCO_LOG.TXT`.

    A handler that somebody else has set stays.
    """
    import mujoco

    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_say)


def _say(message: str | bytes) -> None:
    text = " ".join((message.decode(errors="replace") if isinstance(message, bytes) else message).split())
    if text not in _said:
        _said.add(text)
        print(f"note     MuJoCo: {text}", file=sys.stderr)
