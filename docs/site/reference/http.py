"""The HTTP interface, from the OpenAPI description that a daemon serves."""

import json
from collections.abc import Iterator
from typing import Any, Final, cast

from docs.site.reference.text import code, sentence, table
from piezod.daemon.service.app import create_app
from piezod.messages.requests import TABLE

_ROWS: Final = {(row.method.lower(), f"/v1/{row.path}"): row for row in TABLE.values()}


_STATUS: Final = {"default": "any error"}


def page() -> Iterator[str]:
    """Yield the page."""
    document = openapi()
    yield "# HTTP"
    yield ""
    yield "[Moving a stage from a script](../client.md#http) has examples. `GET /v1/openapi` of a"
    yield "running stage returns the OpenAPI description that this page is made from."
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield from _operation(method, path, operation)
    yield "\n## Schemas\n"
    for name, schema in sorted(document["components"]["schemas"].items()):
        yield f"\n### {name} {{ #{name.lower()} }}\n"
        yield sentence(schema.get("description", "").partition("\n\n")[0])
        yield from _properties(schema)


def openapi() -> dict[str, Any]:
    """Return the description that a daemon serves."""
    # No endpoint is called, so that neither a stage nor roles are needed.
    app = create_app(cast("Any", None), cast("Any", None))
    document: dict[str, Any] = json.loads(json.dumps(app.openapi()))
    return document


def _operation(method: str, path: str, operation: dict[str, Any]) -> Iterator[str]:
    row = _ROWS[method, path]
    yield f"\n## `{method.upper()} {path}` {{ #{operation['operationId']} }}\n"
    yield row.help
    lease = ", with the lease" if row.access.lease else ""
    yield f"\nLeast role: {row.access.role.name.lower()}{lease}.\n"
    rows = [
        (code(each["name"]), each["in"], _type(each["schema"]), each.get("description", ""))
        for each in operation.get("parameters", [])
    ]
    yield from table(("parameter", "in", "value", "meaning"), rows)
    for kind, content in operation.get("requestBody", {}).get("content", {}).items():
        yield f"\nBody, `{kind}`: {_type(content.get('schema', {}))}\n"
    answers = []
    for status, answer in operation["responses"].items():
        for kind, content in answer.get("content", {"": {}}).items():
            value = _type(content.get("schema", {}))
            answers.append((_STATUS.get(status, status), code(kind), value))
    yield from table(("status", "content", "value"), answers)


def _properties(schema: dict[str, Any]) -> Iterator[str]:
    required = schema.get("required", [])
    rows = []
    for name, each in schema.get("properties", {}).items():
        default = "required" if name in required else code(json.dumps(each.get("default")))
        rows.append((code(name), _type(each), default, sentence(each.get("description", ""))))
    yield from table(("key", "value", "default", "meaning"), rows)


def _type(schema: dict[str, Any]) -> str:
    if reference := schema.get("$ref"):
        name = reference.rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "const" in schema or "enum" in schema:
        words = [schema["const"]] if "const" in schema else schema["enum"]
        return ", ".join(code(word) for word in words)
    for choice in ("anyOf", "oneOf"):
        if choice in schema:
            return " or ".join(dict.fromkeys(map(_type, schema[choice])))
    return _plain(schema)


def _plain(schema: dict[str, Any]) -> str:
    kind = schema.get("type", "any value")
    if kind == "array":
        return f"array of {_type(schema.get('items', {}))}"
    if kind == "object" and (inner := schema.get("additionalProperties")):
        return f"object: {_type(inner)}" if isinstance(inner, dict) else "object"
    if {"minimum", "maximum"} <= schema.keys():
        return f"{kind}, {schema['minimum']:.12g} to {schema['maximum']:.12g}"
    return str(kind)
