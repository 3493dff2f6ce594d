"""The Accept header: which of the media types on offer the client wants most."""

from collections.abc import Sequence

from app.errors import NotAcceptable


def _preference(entry: str) -> tuple[str, float]:
    kind, *parameters = (part.strip().lower() for part in entry.split(";"))
    weights = (parameter[2:] for parameter in parameters if parameter.startswith("q="))
    try:
        return kind, float(next(weights, "1"))
    except ValueError:
        return kind, 0.0


def _fits(wanted: str, offered: str) -> int:
    """How exactly a wanted type fits an offered one; 0 is not at all."""
    if wanted == offered:
        return 3
    if wanted.endswith("/*") and wanted != "*/*" and offered.startswith(wanted[:-1]):
        return 2
    return 1 if wanted == "*/*" else 0


def chosen(header: str | None, offered: Sequence[str]) -> str:
    """Return the offered type that the client prefers; of equals the first offered.

    >>> chosen("text/html;q=0.5, application/json", ("text/html", "application/json"))
    'application/json'
    >>> chosen(None, ("text/html", "application/json"))
    'text/html'

    Raises:
        NotAcceptable: if it wants none of them.
    """
    wanted = [_preference(entry) for entry in (header or "*/*").split(",")]

    def weight(kind: str) -> float:
        return max(((_fits(name, kind), q) for name, q in wanted if _fits(name, kind)), default=(0, 0.0))[1]

    best = max(offered, key=weight)
    if weight(best) <= 0:
        raise NotAcceptable(f"Accept asks for {header}; offered are {', '.join(offered)}.")
    return best
