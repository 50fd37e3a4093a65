"""Who may talk to the studio: this machine's browser, from the address that the command printed, and no other page.

An ASGI middleware in front of everything that the server answers. The address carries a random token once; after that a
cookie does, which no script can read and which no other page's request carries.
"""

import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlencode

MOST = 2**20
"""Bytes of a request."""

MOST_UPLOADED = 2**25
"""Bytes of a file: a printer's raw record of two minutes has some 20 MB."""

UPLOAD = re.compile(r"/_nicegui/client/[\w-]+/upload/\d+")
"""The path of a request that brings a file."""

POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; form-action 'self'; "
    "base-uri 'self'; object-src 'none'"
)
"""The page takes nothing from any other address; its library needs inline code."""

HEADERS = [
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
]

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]


class TooLargeError(Exception):
    """A request's body is longer than it may be."""


class Guard:
    """Refuses requests without the token, from another origin, for another host's name, and bodies that are too long.

    Attributes:
        token: that the address carries.
        port: of the server.
    """

    def __init__(self, app: Callable[..., Awaitable[None]], token: str, port: int):
        self.app, self.token, self.port = app, token, port

    @property
    def cookie(self) -> str:
        """The cookie's name; ports of one host share their cookies."""
        return f"jshape_studio_{self.port}"

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer or pass on a request."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        status, words, extra = self.judged(scope)
        if status == 200:
            await self._passed(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await _answered(send, status, words, extra)

    def judged(self, scope: Message) -> tuple[int, str, list[tuple[bytes, bytes]]]:
        """The status of a request (200: it may pass), with words and headers for the others."""
        headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        hosts = [f"{name}:{self.port}" for name in ("127.0.0.1", "localhost")]
        if headers.get(b"host") not in hosts:
            return 403, "the studio answers to 127.0.0.1 alone", []
        if (origin := headers.get(b"origin")) is not None and origin not in [f"http://{host}" for host in hosts]:
            return 403, "another page may not talk to the studio", []
        if headers.get(b"sec-fetch-site", "none") == "cross-site":
            return 403, "another page may not talk to the studio", []
        length, most = headers.get(b"content-length", "0"), _most(scope["path"])
        if not re.fullmatch(r"\d{1,12}", length) or int(length) > most:
            return 413, f"at most {most} bytes", []
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        given = query.get("token", [""])[0]
        if scope["type"] == "http" and scope["path"] == "/" and self._right(given):
            value = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
            # A link's state goes on, without the token.
            kept = urlencode({"state": query["state"][0]}) if "state" in query else ""
            place = f"/?{kept}" if kept else "/"
            return 303, "", [(b"location", place.encode()), (b"set-cookie", value.encode())]
        if not self._right(self._carried(headers.get(b"cookie", ""))):
            return 403, "open the address that the command jshape studio printed", []
        return 200, "", []

    def _carried(self, text: str) -> str:
        try:
            found = SimpleCookie(text).get(self.cookie)
        except CookieError:
            return ""
        return found.value if found is not None else ""

    def _right(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self.token.encode())

    async def _passed(self, scope: Message, receive: Receive, send: Send) -> None:
        """Pass a request on; its body is counted, also where it did not say how long it is."""
        count, begun, most = 0, False, _most(scope["path"])

        async def counted() -> Message:
            nonlocal count
            message = await receive()
            if message["type"] == "http.request":
                count += len(message.get("body", b""))
                if count > most:
                    raise TooLargeError
            return message

        async def with_headers(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                message = {**message, "headers": [*message.get("headers", ()), *HEADERS]}
            await send(message)

        try:
            await self.app(scope, counted, with_headers)
        except TooLargeError:
            if not begun:
                await _answered(send, 413, f"at most {most} bytes", [])


def _most(path: str) -> int:
    """Bytes of a request; a file comes with some hundred bytes about it."""
    return MOST_UPLOADED + 4096 if UPLOAD.fullmatch(path) else MOST


async def _answered(send: Send, status: int, words: str, extra: list[tuple[bytes, bytes]]) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS, *extra]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": words.encode()})
