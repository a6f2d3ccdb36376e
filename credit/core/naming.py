"""What a class is called where it was registered, wherever it is defined."""

from __future__ import annotations

import re


def registered_name(module: str, name: str) -> str:
    """The one name of a class within its kind, wherever it is defined; `package:name` for other packages.

    Args:
        module: in which it is; of it, the package counts. name: of the class.

    Example:
        >>> registered_name("credit.recovery.bonuses", "LocalMSE"), registered_name("shop.rules", "HTTPOutcome")
        ('local_mse', 'shop:http_outcome')
    """
    package = module.partition(".")[0]
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
    return name if package == "credit" else f"{package}:{name}"
