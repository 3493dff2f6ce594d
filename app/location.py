"""Where a thing is, for a Location header: percent-encoded, whatever its name."""

from urllib.parse import quote

from fastapi import Request


def location(request: Request, route: str, **path: str) -> str:
    """Return the path of a route, below the path under which a proxy serves us."""
    quoted = {name: quote(value, safe="") for name, value in path.items()}
    return str(request.url_for(route, **quoted).path)
