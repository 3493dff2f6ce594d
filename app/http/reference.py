"""The OpenAPI document: roles, problems and examples; and the reference page made from it."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from fastapi import FastAPI, Request
from fastapi.openapi.utils import get_openapi
from jinja2 import Environment, PackageLoader, Template
from markupsafe import Markup, escape

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


@dataclass(frozen=True)
class Part:
    """One field of a request's body: its name, what it may be, whether it must be there, and what it means."""

    name: str
    kind: str
    required: bool
    meaning: str


@dataclass(frozen=True)
class Body:
    """What a request may send in one media type: its fields, none where it is one text, and an example."""

    media_type: str
    parts: tuple[Part, ...]
    meaning: str
    example: str


def bodies(operation: Mapping[str, Any], document: Mapping[str, Any]) -> list[Body]:
    """Return what an operation takes in its body, one entry for each media type."""
    content = operation.get("requestBody", {}).get("content", {})
    return [_body(media_type, described, document) for media_type, described in content.items()]


def _body(media_type: str, described: Mapping[str, Any], document: Mapping[str, Any]) -> Body:
    schema = resolved(described["schema"], document)
    examples = schema.get("examples") or [described.get("example")]
    example = examples[0] if isinstance(examples[0], str) else examples[0] and json.dumps(examples[0], indent=2)
    return Body(media_type, tuple(_parts(schema, document)), schema.get("description", ""), example or "")


def resolved(schema: Mapping[str, Any], document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema without its reference, of what may be null what else it may be."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return {**document["components"]["schemas"][name], **{k: v for k, v in schema.items() if k != "$ref"}}
    choices = [one for one in schema.get("anyOf", ()) if one.get("type") != "null"]
    if len(choices) == 1:
        return {**resolved(choices[0], document), **{k: v for k, v in schema.items() if k != "anyOf"}}
    return dict(schema)


def _parts(schema: Mapping[str, Any], document: Mapping[str, Any], before: str = "") -> Iterator[Part]:
    for name, given in schema.get("properties", {}).items():
        part = resolved(given, document)
        required = name in schema.get("required", ())
        yield Part(f"{before}{name}", kind_of(part, document), required, meaning_of(part))
        inner = resolved(part.get("items", {}), document) if part.get("type") == "array" else part
        yield from _parts(inner, document, f"{before}{name}{'[]' if inner is not part else ''}.")


def kind_of(schema: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    """Say what a value may be.

    >>> kind_of({"type": "integer", "minimum": 0, "maximum": 63}, {}), kind_of({"enum": ["open", "done"]}, {})
    ('integer, 0 to 63', 'open or done')
    """
    schema = resolved(schema, document)
    if "const" in schema or "enum" in schema:
        return " or ".join(map(str, schema.get("enum", [schema.get("const")])))
    if "anyOf" in schema:
        return " or ".join(kind_of(one, document) for one in schema["anyOf"])
    kind = "file" if schema.get("format") == "binary" else str(schema.get("type", "any"))
    if kind == "array" and "items" in schema:
        return f"list of {kind_of(schema['items'], document)}"
    low, high = schema.get("minimum"), schema.get("maximum")
    bounds = f"{low:g} to {high:g}" if low is not None and high is not None else f"{low:g} or more" if low else ""
    above = f"above {schema['exclusiveMinimum']:g}" if "exclusiveMinimum" in schema else ""
    return ", ".join(part for part in (kind, bounds, above) if part)


def meaning_of(schema: Mapping[str, Any]) -> str:
    """Return what a value means, with its default where that says something."""
    default = schema.get("default")
    told = "" if default in (None, [], {}) or isinstance(default, dict) else f"by default {default}"
    paragraph = str(schema.get("description", "")).partition("\n\n")[0]
    return "; ".join(part for part in (paragraph.removesuffix("."), told) if part)


def with_code(text: str) -> Markup:
    """Write what stands between two backticks as code.

    >>> with_code("by `Accept` & more")
    Markup('by <code>Accept</code> &amp; more')
    """
    parts = str(escape(text)).split("`")
    return Markup("".join(f"<code>{part}</code>" if k % 2 else part for k, part in enumerate(parts)))  # noqa: S704


@cache
def _template() -> Template:
    loader = PackageLoader("app", ".")
    environment = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["code"] = with_code
    return environment.get_template("reference.html")


def reference_page(document: dict[str, Any], address: str) -> str:
    """Return the reference as one HTML page without scripts; `address`: under which the service was asked."""
    operations = [
        {
            "method": method.upper(),
            "path": path,
            "role": role_of(operation),
            "bodies": bodies(operation, document),
            **operation,
            "parameters": [
                Part(
                    each["name"],
                    f"{each['in']}: {kind_of(each['schema'], document)}",
                    each.get("required", False),
                    meaning_of({**resolved(each["schema"], document), **each}),
                )
                for each in operation.get("parameters", ())
            ],
        }
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    groups: dict[str, list[dict[str, Any]]] = {}
    for operation in operations:
        groups.setdefault((operation.get("tags") or ["service"])[0], []).append(operation)
    return _template().render(info=document["info"], groups=groups, address=address.rstrip("/"))
