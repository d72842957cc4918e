"""Who may open the page of a session: programs of this computer that have its token."""

import dataclasses
import functools
import hmac
import os
import secrets
import socket
from pathlib import Path

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from glider.errors import InputError, expect
from glider.files import schema
from glider.files.writing import replace_file

HOST = "127.0.0.1"

_HEADER = "x-glider-lab"
"""Header of each request that changes something: pages of other sites cannot send it,
also those of other ports of this computer, which get the cookie too."""


_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
"""Headers of each answer, unless it has others."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Address:
    """Where a session's page is, also after a restart."""

    port: int
    token: str

    def __post_init__(self):
        """Raises InputError where it is none."""
        expect(0 < self.port < 1 << 16, "field 'port'", self.port, "from 1 to 65535")
        expect(len(self.token) >= 20, "field 'token'", "a short one", "20 characters")

    @property
    def url(self) -> str:
        """The page, for a browser."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    @property
    def cookie(self) -> str:
        """Name of the cookie: of this port, as cookies are those of all ports."""
        return f"glider_lab_{self.port}"


def listen(file: Path, port: int) -> tuple[socket.socket, Address]:
    """Listens where the session was before if it can; a port of 0 stands for any.

    Raises:
        InputError: the port that was asked for is not free.
    """
    known = schema.load_json(Address, file, "an address") if file.exists() else None
    for wanted in [port] if port else [known.port if known else 0, 0]:
        try:
            listening = socket.create_server((HOST, wanted))
        except OSError as error:
            if port:
                raise InputError(
                    f"--port {port}: {error.strerror}; expected a free port."
                ) from None
            continue
        token = known.token if known else secrets.token_urlsafe(18)
        address = Address(port=listening.getsockname()[1], token=token)
        text = schema.json_text(address)
        replace_file(file, functools.partial(_write_secret, text=text))
        return listening, address
    raise InputError("No port of this computer is free; expected one.")


def _write_secret(path: Path, text: str) -> None:
    with open(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600), "w") as file:
        file.write(text)


class TokenGate:
    """Lets in who has the token, in the address or in the cookie that it leaves."""

    def __init__(self, app: ASGIApp, address: Address) -> None:
        self._app = app
        self._address = address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers 403, or passes a request on."""

        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        if scope["type"] == "lifespan" or self._may(Request(scope)):
            await self._app(scope, receive, send_safely)
        else:
            words = "Expected the token of this session: open the address it printed.\n"
            await PlainTextResponse(words, 403)(scope, receive, send)

    def _may(self, request: Request) -> bool:
        given = request.query_params.get("token")
        shown = given or request.cookies.get(self._address.cookie, "")
        is_known = hmac.compare_digest(shown.encode(), self._address.token.encode())
        return is_known and (request.method == "GET" or _HEADER in request.headers)
