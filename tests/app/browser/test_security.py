"""Nobody gets in without the token, from another page, or under another name."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest

from jaxmodel.app.browser.security import Guard, Keys

TOKEN = "a-word-for-tests"


class Asked:
    """The application behind the guard: it writes down who reached it."""

    def __init__(self) -> None:
        self.users: list[str] = []

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.users.append(scope["state"]["user"])
        await send({"type": "http.response.start", "status": 200, "headers": []})


class Bench:
    """A guard with a request to try on it."""

    def __init__(self, folder: Path, host: str = "127.0.0.1") -> None:
        self.keys, self.inside = Keys(folder, TOKEN), Asked()
        self.guard = Guard(self.inside, keys=self.keys, host=host, port=8765)

    def ask(
        self, method: str = "GET", query: str = "", kind: str = "http", path: str = "/", **headers: str
    ) -> tuple[int, dict[str, str]]:
        """Return status and headers of the answer; of a socket the code that closed it, 0 where it was let through."""
        given = {"host": "127.0.0.1:8765", **{name.replace("_", "-"): value for name, value in headers.items()}}
        scope = {"type": kind, "method": method, "path": path, "query_string": query.encode()}
        scope["headers"] = [(name.encode(), value.encode()) for name, value in given.items()]
        sent: list[Any] = []

        async def send(message: Any) -> None:
            sent.append(message)

        async def receive() -> Any:
            return {}

        # Nothing here waits, so the guard needs no event loop; that of the browser's tests may be running.
        with contextlib.suppress(StopIteration):
            self.guard(scope, receive, send).send(None)
        first = sent[0]
        if first["type"] == "websocket.close":
            return first["code"], {}
        return first["status"], {name.decode(): value.decode() for name, value in first["headers"]}

    def cookie(self, user: str = "0" * 32) -> str:
        return f"{self.guard.cookie}={self.keys.cookie_for(user)}"


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_without_a_token_nothing_is_reached(bench: Bench) -> None:
    assert bench.ask()[0] == 401
    assert bench.ask(query="token=guessed")[0] == 401
    assert bench.ask(kind="websocket", origin="http://127.0.0.1:8765")[0] == 4401
    assert bench.inside.users == []


def test_the_token_is_exchanged_for_a_cookie_that_scripts_and_other_sites_do_not_get(bench: Bench) -> None:
    status, headers = bench.ask(query=f"token={TOKEN}")
    assert (status, headers["location"]) == (303, "/")
    assert {"HttpOnly", "SameSite=Strict"} <= set(headers["set-cookie"].split("; "))
    assert bench.ask(cookie=headers["set-cookie"].split(";")[0])[0] == 200


def test_the_way_on_leads_to_no_other_host(bench: Bench) -> None:
    assert bench.ask(query=f"token={TOKEN}", path="//evil.example/x")[1]["location"] == "/evil.example/x"


def test_a_cookie_that_was_not_signed_here_is_none(bench: Bench, tmp_path: Path) -> None:
    forged = f"{bench.guard.cookie}={'1' * 32}.{'0' * 64}"
    assert bench.ask(cookie=forged)[0] == 401
    # The key is kept: after a restart, with another token, the cookie is still good.
    again = Bench(tmp_path)
    assert again.ask(cookie=bench.cookie())[0] == 200
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8765", "127.0.0.1:80", "127.0.0.1.evil.example:8765", ""]
)
def test_another_name_is_refused(bench: Bench, host: str) -> None:
    assert bench.ask(cookie=bench.cookie(), host=host)[0] == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9999", "null", "http://localhost:8765"])
def test_another_origin_is_refused(bench: Bench, origin: str) -> None:
    assert bench.ask(cookie=bench.cookie(), origin=origin)[0] == 403
    assert bench.ask(kind="websocket", cookie=bench.cookie(), origin=origin)[0] == 4403


def test_writing_and_sockets_need_an_origin(bench: Bench) -> None:
    assert bench.ask("PUT", cookie=bench.cookie())[0] == 403
    assert bench.ask(kind="websocket", cookie=bench.cookie())[0] == 4403
    own = "http://127.0.0.1:8765"
    assert bench.ask("PUT", cookie=bench.cookie(), origin=own)[0] == 200


def test_every_interface_takes_addresses_and_no_names(tmp_path: Path) -> None:
    bench = Bench(tmp_path, host="0.0.0.0")
    assert bench.ask(cookie=bench.cookie(), host="192.0.2.7:8765")[0] == 200
    assert bench.ask(cookie=bench.cookie(), host="evil.example:8765")[0] == 421


def test_pages_may_load_from_here_alone(bench: Bench) -> None:
    policy = bench.ask(cookie=bench.cookie())[1]["content-security-policy"]
    assert policy.startswith("default-src 'self'")
    assert "http" not in policy
