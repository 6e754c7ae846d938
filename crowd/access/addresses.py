"""Where a request comes from: its address, its network, and whether it is this machine itself.

Behind proxies (FRONTRUNNER_PROXIES) the client is the address that the outermost of them saw.
"""

import ipaddress
import re
from collections.abc import Iterable
from typing import cast

from django.http import HttpRequest
from django.utils.crypto import salted_hmac
from rest_framework.request import Request
from rest_framework.throttling import BaseThrottle

# Some proxies add the port: 198.51.100.1:4711, [2001:db8::1]:4711.
WITH_PORT = re.compile(r"^(?:\[(.+)\]|([0-9.]+))(?::[0-9]+)?$")
# Every proxy adds one of these: a request without them comes directly from the connection's other end.
FORWARDED = ("HTTP_X_FORWARDED_FOR", "HTTP_FORWARDED", "HTTP_X_REAL_IP", "HTTP_VIA")
NETWORK_BITS = {4: 24, 6: 48}
# Stored hashes were made with this salt: with another salt, no stored network would be recognised.
NETWORK_SALT = "crowd.access.limits.network"

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Network = ipaddress.IPv4Network | ipaddress.IPv6Network


def address_of(request: Request | HttpRequest) -> str:
    """The client's address, or the proxy's text where that is not an address.

    An IPv6 address is cut to its network (/64), because one machine owns all addresses in it.
    """
    text, address = _client(request)
    if address is None:
        return text
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    return str(ipaddress.IPv6Network((int(address), 64), strict=False))


def network_hash(request: Request | HttpRequest) -> str:
    """A keyed hash of the client's network: /24 with IPv4, /48 with IPv6; "" where unknown.

    The key is derived from SECRET_KEY. The hash is the same every day, and only this server can compute it.
    """
    _, address = _client(request)
    if address is None:
        return ""
    network = ipaddress.ip_network((int(address), NETWORK_BITS[address.version]), strict=False)
    return salted_hmac(NETWORK_SALT, str(network), algorithm="sha256").hexdigest()[:32]


def is_this_machine(request: HttpRequest) -> bool:
    """Whether `request` comes directly from this machine, not through a proxy on it."""
    if any(name in request.META for name in FORWARDED):
        return False
    address = _parsed(request.META.get("REMOTE_ADDR", ""))
    return address is not None and address.is_loopback


def is_within(request: HttpRequest, networks: Iterable[Network]) -> bool:
    """Whether the client's address is in one of `networks`."""
    _, address = _client(request)
    return address is not None and any(address in network for network in networks)


def _client(request: Request | HttpRequest) -> tuple[str, Address | None]:
    """The client's address as the server receives it, and parsed; None where it is not an address."""
    text = str(BaseThrottle().get_ident(cast(Request, request)))
    return text, _parsed(text)


def _parsed(text: str) -> Address | None:
    """`text`, with or without a port, as an address; an IPv4 address also where a socket maps it to IPv6."""
    try:
        address = ipaddress.ip_address(WITH_PORT.sub(r"\1\2", text))
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address
