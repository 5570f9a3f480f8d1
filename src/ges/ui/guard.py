"""Protection of a server on loopback from other pages, and headers of what it serves."""

from __future__ import annotations

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOSTS = ("127.0.0.1", "localhost")
"""Names by which the server may be called; any other is a page elsewhere that had its name point
here.
"""
OWN_PAGES = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self';"
    " img-src data:; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
"""What a page of the server may load: its own script and style sheet."""
REPORTS = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline';"
    " script-src 'unsafe-inline'; base-uri 'none'; frame-ancestors 'none'"
)
"""What a report may do, which holds its own script: it is of no origin and reaches nothing."""
HEADERS = {
    "content-security-policy": OWN_PAGES,
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """Middleware that refuses requests of other pages and large ones, and adds :data:`HEADERS`.

    Parameters
    ----------
    app : application to guard.
    limit_bytes : largest size of one request.
    """

    def __init__(self, app: ASGIApp, limit_bytes: int) -> None:
        self.app, self.limit_bytes = app, limit_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    # a report brings stricter rules of its own
                    headers.setdefault(name, value)
            await send(message)

        refusal = self._refusal(scope["method"], Headers(scope=scope))
        await (refusal or self.app)(scope, receive, with_headers)

    def _refusal(self, method: str, headers: Headers) -> PlainTextResponse | None:
        own = f"http://{headers.get('host', '')}"
        # a GET changes nothing; with all else a browser says which page sent it
        if method != "GET" and headers.get("origin", own) != own:
            return PlainTextResponse(
                "This came from another page; open this one and try again.", 403
            )
        length = headers.get("content-length", "0")
        # refused by what it states, before a byte of it is read; int() takes no thousands of digits
        if not length.isdecimal() or len(length) > 18 or int(length) > self.limit_bytes:
            return PlainTextResponse(too_large(self.limit_bytes), 413)
        return None


def too_large(limit_bytes: int) -> str:
    """Say that an upload is beyond the limit.

    Parameters
    ----------
    limit_bytes : the limit.
    """
    return (
        f"These files are larger than {limit_bytes / 1e6:.0f} MB together; drop fewer of them, or"
        " start ges ui with a larger --limit."
    )
