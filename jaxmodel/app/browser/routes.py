"""The addresses that pages fetch data from and send files to, each within one session of the user of the cookie."""

from __future__ import annotations

import io
import os
import zipfile
from pathlib import Path

from fastapi import HTTPException, Request, Response
from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse
from nicegui import app, run

from jaxmodel.app.browser.files import KEPT
from jaxmodel.app.browser.sessions import MOST_OF_A_FILE, Session, Sessions, UploadRefused
from jaxmodel.app.browser.traces import MOST_POINTS, preview, samples, traces


def add_routes(sessions: Sessions) -> None:
    """Add the addresses below `/s/SESSION/` to the application."""

    def own(request: Request, name: str) -> Session:
        """Return a session of the user of this request; that of another is not found."""
        session = sessions.of(request.state.user, name)
        if session is None:
            raise HTTPException(404, "There is no such session.")
        return session

    def with_traces(session: Session) -> dict:
        if "case" not in session.view:
            raise HTTPException(404, "There is no data yet.")
        return session.view

    @app.get("/s/{name}/traces")
    async def get_traces(
        request: Request, name: str, runs: str = "0", low: float | None = None, high: float | None = None,
        points: int = MOST_POINTS,
    ) -> Response:  # fmt: skip
        session = own(request, name)
        numbers = [int(one) for one in runs.split(",") if one.isdigit()]
        view = with_traces(session)
        return JSONResponse(await run.io_bound(traces, session.folder, view, numbers, (low, high), points))

    @app.get("/s/{name}/preview")
    async def get_preview(request: Request, name: str, candidate: str = "") -> Response:
        session = own(request, name)
        return JSONResponse(await run.io_bound(preview, session.folder, with_traces(session), candidate))

    @app.get("/s/{name}/samples")
    async def get_samples(request: Request, name: str, channel: str, cell: int) -> Response:
        session = own(request, name)
        return JSONResponse(await run.io_bound(samples, session.folder, with_traces(session), channel, cell))

    @app.put("/s/{name}/files/{file}")
    async def put_file(request: Request, name: str, file: str) -> Response:
        session = own(request, name)
        try:
            place = session.place_for(file, int(request.headers.get("content-length") or 0))
            await _receive(request, place)
        except UploadRefused as error:
            return PlainTextResponse(str(error), 413)
        return PlainTextResponse(place.name, 201)

    @app.get("/s/{name}/case")
    async def get_case(request: Request, name: str) -> Response:
        view = with_traces(own(request, name))
        return FileResponse(view["path"], media_type="text/plain; charset=utf-8")

    @app.get("/s/{name}/kept/{file}")
    async def get_kept(request: Request, name: str, file: str) -> Response:
        session = own(request, name)
        if file not in [one["name"] for one in session.view.get("kept") or []]:
            raise HTTPException(404, "There is no such file.")
        kind = None if file.endswith((".html", ".png")) else "text/plain; charset=utf-8"
        return FileResponse(session.folder / KEPT / file, media_type=kind)

    @app.get("/s/{name}/kept.zip")
    async def get_all(request: Request, name: str) -> Response:
        session = own(request, name)
        names = [one["name"] for one in session.view.get("kept") or []]
        return Response(await run.io_bound(_zipped, session.folder / KEPT, names), media_type="application/zip")


async def _receive(request: Request, place: Path) -> None:
    """Write the body of a request to a file, and stop where it grows beyond the limit.

    Raises:
        UploadRefused: it does.
    """
    aside = place.with_name(f".{place.name}.part")
    taken = 0
    try:
        with aside.open("wb") as out:
            async for part in request.stream():
                taken += len(part)
                if taken > MOST_OF_A_FILE:
                    raise UploadRefused(f"{place.name} is larger than {MOST_OF_A_FILE // 2**20} MB.")
                out.write(part)
        os.replace(aside, place)
    finally:
        aside.unlink(missing_ok=True)


def _zipped(folder: Path, names: list[str]) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.write(folder / name, name)
    return held.getvalue()
