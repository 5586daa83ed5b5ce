"""The server of the workbench: pages on loopback, behind the guard, with a worker for each session."""

from __future__ import annotations

import os
import threading
import time
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import plotly
from fastapi import Request
from fastapi.responses import RedirectResponse
from nicegui import app, ui

from jaxmodel.app.browser.page import Page
from jaxmodel.app.browser.routes import add_routes
from jaxmodel.app.browser.security import EVERY, Guard, Keys
from jaxmodel.app.browser.sessions import Sessions
from jaxmodel.app.browser.workers import Workers
from jaxmodel.app.terminal import say

STATIC = Path(__file__).parent / "static"
_HEAD = (
    '<link rel="stylesheet" href="/assets/workbench.css">'
    '<script src="/assets/theme.js"></script>'
    '<script src="/assets/touch.js"></script>'
    '<link rel="preload" as="script" href="/plotly/plotly.min.js">'
)
# Seconds between two looks at workers that have nothing to do.
_HOUSEKEEPING_S = 20.0


def serve(
    folder: Path,
    *,
    host: str,
    port: int,
    token: str | None,
    show: bool,
    opening: Mapping[str, Any] | None,
    forget_days: float | None = None,
) -> None:
    """Serve the workbench until it is interrupted.

    Args:
        folder: for the sessions.
        host: address to listen on.
        port: to listen on.
        token: that lets a browser in; by default a random one.
        show: open the page in a browser.
        opening: the first job of the first session: `do` and `with`; None for an empty session.
        forget_days: remove the sessions that have not been used for so many days; None to keep all.
    """
    os.umask(0o077)
    sessions, workers = Sessions(folder), Workers()
    if forget_days is not None:
        removed = sessions.remove_unused(time.time() - 86_400.0 * forget_days)
        say(f"Removed {removed} sessions that were not used for {forget_days:g} days.")
    keys = Keys(folder, token)
    first = [opening] if opening else []
    _add_pages(sessions, workers, first)
    add_routes(sessions)
    app.add_static_files("/assets", STATIC)
    app.add_static_file(local_file=_plotly_js(), url_path="/plotly/plotly.min.js", max_cache_age=86400)
    name = f"[{host}]" if ":" in host else host
    app.add_middleware(Guard, keys=keys, host=name, port=port)  # type: ignore[arg-type]
    app.on_shutdown(workers.end_all)
    address = f"http://{'127.0.0.1' if name in EVERY else name}:{port}/?token={keys.token}"
    app.on_startup(lambda: say(f"The workbench is at {address}"))
    # Counted beside the server: large sessions must not keep the first page waiting.
    app.on_startup(lambda: threading.Thread(target=_say_what_stays, args=(sessions, folder), daemon=True).start())
    if show:
        app.on_startup(lambda: threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start())
    app.timer(_HOUSEKEEPING_S, lambda: _keep_house(workers))
    ui.run(
        host=host,
        port=port,
        title="jaxmodel workbench",
        favicon=STATIC / "favicon.svg",
        reload=False,
        show=False,
        show_welcome_message=False,
        tailwind=False,
        gzip_middleware_factory=None,  # over loopback compressing takes longer than sending
        reconnect_timeout=10.0,
        language="en-US",
    )


def _say_what_stays(sessions: Sessions, folder: Path) -> None:
    count, size = sessions.size()
    say(f"Stop it with Ctrl-C; {count} sessions ({size / 1e6:.0f} MB) stay in {folder}.")


def _plotly_js() -> Path:
    return Path(plotly.__file__).parent / "package_data" / "plotly.min.js"


def _keep_house(workers: Workers) -> None:
    workers.begin_waiting()
    workers.end_idle()
    workers.keep_spare()


def _add_pages(sessions: Sessions, workers: Workers, first: list[Mapping[str, Any]]) -> None:
    """Add the pages: the way to a session, a new one, and the session itself."""

    @app.get("/")
    def root(request: Request) -> RedirectResponse:
        """Lead to the latest session; to that of the case on the command line where one is named."""
        user = request.state.user
        if not first:
            return RedirectResponse(f"/s/{(sessions.latest(user) or sessions.new(user)).name}", 303)
        job = first.pop()
        session = next((one for one in sessions.all_of(user) if one.has(job)), None)
        if session is None:
            session = sessions.new(user)
            workers.do(session, job["do"], **job["with"])
        return RedirectResponse(f"/s/{session.name}", 303)

    @app.get("/new")
    def new(request: Request) -> RedirectResponse:
        """Begin a session."""
        return RedirectResponse(f"/s/{sessions.new(request.state.user).name}", 303)

    @ui.page("/s/{name}")
    def session_page(request: Request, name: str, step: str = "") -> None:
        session = sessions.of(request.state.user, name)
        ui.add_head_html(_HEAD)
        if session is None:
            ui.label("There is no such session. Open the address that the workbench printed.").classes("empty")
            return
        workers.take_up(session)
        Page(session, workers, step)
