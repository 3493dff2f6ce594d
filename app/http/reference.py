"""The OpenAPI document: roles, problems and examples."""

from typing import Any

from fastapi import FastAPI, Request
from fastapi.openapi.utils import get_openapi

from app.http.errors import Unprocessable, offered, path_of

PROBLEM = {
    "type": "object",
    "description": "RFC 9457: what was wrong, and what would be right.",
    "required": ["type", "title", "status", "detail", "instance", "request_id"],
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer", "minimum": 400, "maximum": 599},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
        "request_id": {"type": ["string", "null"]},
        "errors": {"type": "array", "items": {"type": "object"}},
    },
}


def problem_response(description: str, status: int, type_: str, title: str, detail: str) -> dict[str, Any]:
    example = {
        "type": type_,
        "title": title,
        "status": status,
        "detail": detail,
        "instance": "/api/v1/cases",
        "request_id": "5f0c2f7e9a1b4d33",
    }
    return {
        "description": description,
        "content": {
            "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}, "example": example}
        },
    }


PROBLEMS: dict[int | str, dict[str, Any]] = {
    "4XX": problem_response(
        "What was wrong with the request, and what would be right",
        403,
        "role-too-low",
        "This key may not do that",
        "This needs the role admin; the key 'bench 3' has the role operator.",
    ),
    "5XX": problem_response(
        "The service failed",
        503,
        "unavailable",
        "The service cannot do this at the moment",
        "The decoding worker could not be started; send the recording again in a minute.",
    ),
}


def role_of(operation: dict[str, Any]) -> str | None:
    """The role that an operation asks for; None where it is open."""
    roles = [role for scheme in operation.get("security", []) for scopes in scheme.values() for role in scopes]
    return roles[0] if roles else None


def describe(app: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI document of the application."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title, version=app.version, description=app.description, routes=app.routes, tags=app.openapi_tags
        )
        document["components"].setdefault("schemas", {})["Problem"] = PROBLEM
        document["servers"] = [{"url": app.root_path or "/"}]
        for operation in (one for methods in document["paths"].values() for one in methods.values()):
            said = operation.get("description") or operation["summary"]
            operation["description"] = f"{said}\n\nRole: {role_of(operation) or 'none'}."
        app.openapi_schema = document
    return app.openapi_schema


def only_known_query(request: Request) -> None:
    """Dependency: refuse a query parameter that nothing reads, such as a mistyped filter, or that is given twice.

    Raises:
        Unprocessable: naming it and those that are known.
    """
    given = [name for name, _ in request.query_params.multi_items()]
    if not given:
        return
    twice = sorted({name for name in given if given.count(name) > 1})
    if twice:
        raise Unprocessable(f"Query parameters given more than once: {', '.join(twice)}. Give each once.")
    known = offered(request.app, path_of(request)).get(request.method, frozenset())
    unknown = sorted(set(given) - known)
    if unknown:
        raise Unprocessable(
            f"Unknown query parameters: {', '.join(unknown)}. Known here: {', '.join(sorted(known)) or 'none'}."
        )
