"""MLflow's UI on a store, opened on our page of the newest curves."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Awaitable, Callable
from typing import Any

from credit.core.errors import UserError
from credit.tracking.landing import landing_page, newest_view
from credit.tracking.store import client_of

Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
App = Callable[[dict[str, Any], Receive, Send], Awaitable[None]]


def newest(uri: str) -> str:
    """The address, within MLflow's UI, of the newest curves of a store.

    Raises:
        UserError: the store cannot be read.
    """
    try:
        return newest_view(client_of(uri))
    except Exception as error:  # of the driver, the network, the schema
        raise UserError(f"the tracking store {uri} cannot be read: {error}") from None


def serve(uri: str, host: str, port: int) -> None:
    """Serve the UI until Ctrl-C.

    Args:
        uri: of the store. host, port: where to listen.
    """
    from mlflow.server.constants import BACKEND_STORE_URI_ENV_VAR

    # MLflow's server reads its store from the environment, when it is imported.
    os.environ[BACKEND_STORE_URI_ENV_VAR] = uri
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import uvicorn
        from mlflow.server.fastapi_app import app

    client = client_of(uri)
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.run(
            opening_on(app, lambda: landing_page(client)),
            host=host,
            port=port,
            log_level="warning",
            timeout_graceful_shutdown=1,
        )


def opening_on(app: App, page: Callable[[], str]) -> App:
    """MLflow's application, with a page of our own at `/`; `/?ui` and other hosts are left to MLflow."""
    from starlette.responses import HTMLResponse

    async def opening(scope: dict[str, Any], receive: Receive, send: Send) -> None:
        """Answer one request."""
        host = dict(scope.get("headers", ())).get(b"host", b"").partition(b":")[0]
        at_root = scope["type"] == "http" and scope["path"] == "/" and not scope["query_string"]
        if at_root and host in (b"127.0.0.1", b"localhost"):
            await HTMLResponse(page(), headers={"Cache-Control": "no-store"})(scope, receive, send)
        else:
            await app(scope, receive, send)

    return opening
