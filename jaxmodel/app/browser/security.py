"""Who may talk to the workbench: a check of host, origin and a signed cookie, before any page or socket is reached.

A page on the internet that is open in the same browser could send requests to loopback, and a name that it owns could
be made to point there. So the host must be ours, the origin of anything but a plain visit must be ours, and the browser
must have been let in by the token of the address that the command printed.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
EVERY = ("0.0.0.0", "[::]")  # every interface
_READING = ("GET", "HEAD")
_USER = re.compile(r"[0-9a-f]{32}")
# Everything comes from this server. Vue compiles its templates in the page, for which it needs `unsafe-eval`.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' ws: wss:; frame-ancestors 'none'; "
    "form-action 'self'; base-uri 'self'"
)
_HEADERS = [
    (b"content-security-policy", _POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
]


class Keys:
    """The token that lets a browser in, and the key that signs its cookie.

    The key is kept in the work folder, so that a browser stays let in when the server is started again.
    """

    def __init__(self, folder: Path, token: str | None = None) -> None:
        """Read the key of a work folder, or make one; `token` is by default a random one."""
        path = folder / "key"
        if not path.exists():
            path.touch(mode=0o600)
            path.write_text(secrets.token_hex(32), encoding="ascii")
        self._key = path.read_text(encoding="ascii").encode()
        self.token = token or secrets.token_urlsafe(24)

    def admits(self, token: str) -> bool:
        """Return True for the token."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def cookie_for(self, user: str) -> str:
        """Return the signed name of a user."""
        return f"{user}.{hmac.new(self._key, user.encode(), hashlib.sha256).hexdigest()}"

    def user_of(self, cookie: str) -> str | None:
        """Return the user of a cookie; None if it was not signed here."""
        user, _, _ = cookie.partition(".")
        known = _USER.fullmatch(user) and hmac.compare_digest(cookie.encode(), self.cookie_for(user).encode())
        return user if known else None


class Guard:
    """ASGI middleware that lets only our own pages through; the user of a request is in `scope["state"]["user"]`."""

    def __init__(self, app: Callable[..., Awaitable[None]], *, keys: Keys, host: str, port: int) -> None:
        """Guard an application that is served on a host and port."""
        self._app, self._keys, self._host, self._port = app, keys, host, port
        self.cookie = f"jaxmodel-workbench-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check one request or socket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        if not self.is_own_host(headers.get("host", "")):
            await _refuse(scope, send, 421, "This name is not that of the workbench; open the address that it printed.")
            return
        if not self._is_own_origin(scope, headers):
            await _refuse(scope, send, 403, "This request does not come from a page of the workbench.")
            return
        user = self._keys.user_of(self._cookie_in(headers))
        token = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if scope["type"] == "http" and scope["method"] in _READING and token and self._keys.admits(token):
            await self._let_in(scope, send, user or secrets.token_hex(16))
            return
        if user is None:
            await _refuse(scope, send, 401, "Open the address that `jaxmodel workbench` printed; it holds the token.")
            return
        scope.setdefault("state", {})["user"] = user
        await self._app(scope, receive, _with_headers(send))

    def is_own_host(self, host: str) -> bool:
        """Return True if a Host header names this server."""
        name, _, port = host.rpartition(":") if re.search(r":\d+$", host) else (host, "", "80")
        if port != str(self._port):
            return False
        if self._host in EVERY:  # any address, and no name but that of loopback
            return name == "localhost" or _is_address(name)
        return name == self._host or (self._host in LOOPBACK and name in LOOPBACK)

    def _is_own_origin(self, scope: Scope, headers: dict[str, str]) -> bool:
        """Return True for a request that our page made, or for a plain visit."""
        origin = headers.get("origin")
        if origin is None:
            return scope["type"] == "http" and scope["method"] in _READING
        scheme, _, host = origin.partition("://")
        return scheme in ("http", "https") and host == headers.get("host", "") and self.is_own_host(host)

    def _cookie_in(self, headers: dict[str, str]) -> str:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(self.cookie)
        except CookieError:
            return ""
        return found.value if found else ""

    async def _let_in(self, scope: Scope, send: Send, user: str) -> None:
        """Answer the visit that brings the token with a cookie, and lead to the same page without the token."""
        value = f"{self.cookie}={self._keys.cookie_for(user)}; Path=/; Max-Age=31536000; HttpOnly; SameSite=Strict"
        place = "/" + scope["path"].lstrip("/\\")  # two slashes would lead to another host
        headers = [(b"location", place.encode()), (b"set-cookie", value.encode()), (b"content-length", b"0")]
        await send({"type": "http.response.start", "status": 303, "headers": [*headers, *_HEADERS]})
        await send({"type": "http.response.body", "body": b""})


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def _with_headers(send: Send) -> Send:
    """Return a `send` that adds our headers to every answer."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", []), *_HEADERS]
        await send(message)

    return sending


async def _refuse(scope: Scope, send: Send, status: int, sentence: str) -> None:
    """Answer with one sentence, or close the socket."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 4000 + status, "reason": sentence})
        return
    body = f"{sentence}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode()), *_HEADERS]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
