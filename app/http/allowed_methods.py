"""What the API offers at a path: methods, and the query parameters of each."""

import re
from functools import cache

from fastapi import FastAPI
from starlette.routing import compile_path


@cache
def _offers(app: FastAPI) -> tuple[tuple[re.Pattern[str], dict[str, frozenset[str]]], ...]:
    found = []
    for path, methods in app.openapi()["paths"].items():
        queries = {
            method.upper(): frozenset(each["name"] for each in operation.get("parameters", ()) if each["in"] == "query")
            for method, operation in methods.items()
        }
        found.append((compile_path(path)[0], queries))
    return tuple(found)


def offered(app: FastAPI, path: str) -> dict[str, frozenset[str]]:
    """Return the methods that the API offers at a path, each with the names of its query parameters."""
    return {
        method: names for pattern, queries in _offers(app) if pattern.match(path) for method, names in queries.items()
    }
