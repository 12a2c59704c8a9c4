"""Which web pages may talk to a server of this machine: the rules for `Host` and `Origin`.

A page of a foreign site reaches a server of this machine in two ways. It sends requests across
origins, and the browser then names its site in `Origin`. Or its own domain name suddenly leads to
this machine (DNS rebinding), and then `Host` has that domain name. Nobody owns a name without a dot
or an address, so that both are allowed.
"""

from ipaddress import ip_address


def is_own_host(host: str) -> bool:
    """Return whether no foreign site can have this `Host`: an address, or a name without a dot."""
    name = host_name(host)
    try:
        ip_address(name)
    except ValueError:
        return "." not in name
    return True


def host_name(host: str) -> str:
    """Return the name or address in a `Host`, without the port and in lower case."""
    if host.startswith("["):  # an IPv6 address
        return host[1:].partition("]")[0].lower()
    return host.partition(":")[0].lower()


def is_same_origin(origin: str, host: str) -> bool:
    """Return whether an `Origin` is that of the server itself."""
    return origin.lower() in (f"http://{host.lower()}", f"https://{host.lower()}")
