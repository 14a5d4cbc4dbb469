"""Access to the desk: a token kept in a cookie, and a guard on Host and Origin."""

import hashlib
import hmac
import ipaddress
import os
import secrets
import socket
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

GUEST = web.RequestKey("gruber.guest", bool)
LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
ANYWHERE = frozenset({"0.0.0.0", "::", ""})
ELSEWHERE = ("192.0.2.1", 9)
"""An address that is nobody's (RFC 5737)."""


@dataclass(frozen=True, slots=True)
class Door:
    """Where a desk listens, and how it is reached."""

    host: str = "127.0.0.1"
    """Address the port listens on."""
    port: int = 0
    """Port it listens on; 0 takes any that is free."""
    address: str = ""
    """What browsers open if it is behind a proxy, such as https://desk.example.org; or empty."""

    @property
    def name(self) -> str:
        """The proxy's name; empty without one."""
        return urlsplit(self.address).hostname or ""


@dataclass(frozen=True, slots=True)
class Access:
    """The lock of one desk."""

    door: Door
    """What it locks."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """Secret in the address the operator opens; a cookie afterwards."""
    looking: bool = False
    """Nothing can be decided: everybody is a guest."""

    @property
    def guest_token(self) -> str:
        """Secret of those who only look; from it the other cannot be found."""
        return hmac.new(self.token.encode(), b"guest", hashlib.sha256).hexdigest()[:32]

    @property
    def cookie(self) -> str:
        """Name of the cookie, its own for every desk: cookies do not know ports."""
        return f"gruber_{hashlib.sha256(self.token.encode()).hexdigest()[:8]}"

    def url(self, port: int) -> str:
        """The address to open with the token: the proxy's, or else one of this machine."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self.door.host, self.door.host)
        return f"{self.door.address or f'http://{host}:{port}'}/?token={self.token}"

    def guest_url(self, port: int) -> str:
        """The address for those who may look and decide nothing.

        Where other machines are answered too, it names this one as they see it.
        """
        url = self.url(port).replace(self.token, self.guest_token)
        if self.door.address or self.door.host not in ANYWHERE:
            return url
        return url.replace("//127.0.0.1:", f"//{network_name()}:")

    def guard(self) -> Middleware:
        """The middleware that every request passes first."""

        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            if not self.host_is_ours(request.host):
                raise web.HTTPMisdirectedRequest(text="This desk does not answer to that name.")
            if not self.origin_is_ours(request.headers.get("Origin"), request.host):
                raise web.HTTPForbidden(text="Requests from other sites are refused.")
            entering = request.query.get("token")
            if entering is not None and request.path == "/":
                # A link may name what is to be shown.
                return self._let_in(entering, request)
            shown = request.cookies.get(self.cookie, "")
            if not self._known(shown):
                raise web.HTTPUnauthorized(text="Open the desk with the address it printed.")
            request[GUEST] = self.looking or not self._same(shown, self.token)
            response = await handler(request)
            if not response.prepared:
                response.headers.update(HEADERS)
            return response

        return guarded

    def host_is_ours(self, host: str) -> bool:
        """True for names this desk is reached by: a rebound DNS name is none of them."""
        name, ours = _name_of(host), self.door.host.lower()
        if name and name in (*LOOPBACK, ours, self.door.name):
            return True
        return ours in ANYWHERE and (name == socket.gethostname().lower() or _is_address(name))

    def origin_is_ours(self, origin: str | None, host: str) -> bool:
        """True when a request comes from our own page, or from no page at all."""
        ours = {f"http://{host}".lower(), f"https://{host}".lower()}
        if self.door.address:
            # Not every proxy passes on the name that was asked for.
            ours.add(self.door.address)
        return origin is None or origin.lower() in ours

    def _let_in(self, entering: str, request: web.Request) -> web.StreamResponse:
        """Keep the token in a cookie and take it out of the address bar."""
        if not self._known(entering):
            raise web.HTTPUnauthorized(text="That is not this desk's token.")
        onward = str(request.rel_url.without_query_params("token"))
        response = web.Response(status=303, headers={"Location": onward})
        # At this machine's own address, without the proxy, the desk speaks no TLS.
        behind_tls = self.door.address.startswith("https:")
        secure = behind_tls and _name_of(request.host) == self.door.name
        response.set_cookie(
            self.cookie, entering, httponly=True, samesite="Lax", path="/", secure=secure
        )
        return response

    def _known(self, offered: str) -> bool:
        """True for operators and guests."""
        return self._same(offered, self.token) or self._same(offered, self.guest_token)

    @staticmethod
    def _same(offered: str, secret: str) -> bool:
        return hmac.compare_digest(offered.encode(), secret.encode())


HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "SAMEORIGIN",
    "Referrer-Policy": "no-referrer",
}
"""On every answer."""


def is_guest(request: web.Request) -> bool:
    """True when a request may look and not decide."""
    return request.get(GUEST, True)


def network_name() -> str:
    """The address by which the network knows this machine; its name where there is no network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as door:
        try:
            # Nothing is sent: the system only says which of its addresses it would send from.
            door.connect(ELSEWHERE)
        except OSError:
            return socket.gethostname()
        return door.getsockname()[0]


def _name_of(host: str) -> str:
    """The name in a Host header, without its port."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def lasting_token(hidden: Path) -> str:
    """The desk's secret, kept for its owner only, so that pages find a desk opened again.

    A folder that may not be written keeps none.
    """
    path = hidden / "desk-token"
    try:
        kept = path.read_text(encoding="ascii").strip()
        if len(kept) >= 32:
            return kept
        path.unlink()
    except (FileNotFoundError, UnicodeDecodeError):
        path.unlink(missing_ok=True)
    token = secrets.token_urlsafe(24)
    if not os.access(hidden, os.W_OK):
        return token
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(token)
    return token
