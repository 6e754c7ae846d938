"""A call of the API as its page shows it, read from the OpenAPI document."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from crowd.api_pages import snippets
from crowd.http.codes import CODES, Code

REFERENCE = "#/components/schemas/"
Json = Mapping[str, Any]


@dataclass(frozen=True)
class Type:
    """A type in words; `schema` is the schema that follows the words, or ""."""

    words: str
    schema: str = ""


@dataclass(frozen=True)
class Field:
    """A parameter of a call, or a member of a schema. `place` is query, path or header; "" for a member."""

    name: str
    type: Type
    required: bool
    meaning: str
    place: str = ""
    example: str = ""


@dataclass(frozen=True)
class Schema:
    """A JSON object with its meaning and members."""

    name: str
    meaning: str
    members: tuple[Field, ...]


@dataclass(frozen=True)
class Answer:
    """A successful answer of a call; `schema` is "" if it has no body."""

    status: int
    phrase: str
    schema: str


@dataclass(frozen=True)
class Call:
    """A call with everything that its page shows."""

    key: str
    method: str
    path: str
    topic: str
    summary: str
    description: str
    token: str
    parameters: tuple[Field, ...]
    body: str
    body_example: str
    answers: tuple[Answer, ...]
    curl: str
    python: str
    answer_status: int
    answer_example: str
    schemas: tuple[Schema, ...]
    codes: Mapping[str, Code]


# What each security scheme of a call requires.
TOKENS = {
    "installation": "It needs the token of an installation.",
    "installation_also_revoked": "It needs the token of an installation, which may have been revoked.",
    "installation_where_known": "The token of an installation is optional.",
    "reference_device": "It needs the token of a reference device, which an administrator gives out.",
}


def operations(document: Json) -> dict[str, tuple[str, str, Json]]:
    """The method, path and description of every call of `document`, by key."""
    return {
        operation["operationId"]: (method.upper(), path, operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    }


def call(document: Json, key: str, server: str) -> Call:
    """The call `key` of `document` on `server`, an address without a slash at its end. Raises KeyError."""
    method, path, operation = operations(document)[key]
    schemas = document["components"]["schemas"]
    body = _content(operation.get("requestBody", {}))
    answers = {
        int(status): _content(answer)
        for status, answer in operation["responses"].items()
        if status != "default"
    }
    shown = next((status for status, content in answers.items() if "example" in content), min(answers))
    request = snippets.request_of(server, method, path, operation)
    named = [name for content in (body, *answers.values()) for name in _references(content.get("schema", {}))]
    return Call(
        key=key,
        method=method,
        path=path,
        topic=operation["tags"][0],
        summary=operation["summary"],
        description=operation.get("description", ""),
        token=next((TOKENS[name] for each in operation.get("security", ()) for name in each), ""),
        parameters=tuple(_parameter(one) for one in operation.get("parameters", ())),
        body=next(_references(body.get("schema", {})), ""),
        body_example=snippets.pretty_json(body["example"]) if "example" in body else "",
        answers=tuple(
            Answer(status, HTTPStatus(status).phrase, next(_references(content.get("schema", {})), ""))
            for status, content in sorted(answers.items())
        ),
        curl=snippets.curl(request),
        python=snippets.python(request),
        answer_status=shown,
        answer_example=snippets.pretty_json(answers[shown]["example"]) if "example" in answers[shown] else "",
        schemas=tuple(_schema(name, schemas[name]) for name in _with_nested(named, schemas)),
        codes={name: CODES[name] for name in operation["x-codes"]},
    )


def _content(part: Json) -> Json:
    """The JSON content of a request or an answer; empty if there is none."""
    content: Json = part.get("content", {}).get("application/json", {})
    return content


def _parameter(one: Json) -> Field:
    return Field(
        name=one["name"],
        type=type_of(one["schema"]),
        required=one.get("required", False),
        meaning=one.get("description", ""),
        place=one["in"],
        example=str(one.get("example", "")),
    )


def _schema(name: str, schema: Json) -> Schema:
    required = schema.get("required", ())
    return Schema(
        name=name,
        meaning=" ".join(schema.get("description", "").split()),
        members=tuple(
            Field(member, type_of(each), member in required, each.get("description", ""))
            for member, each in schema.get("properties", {}).items()
        ),
    )


def type_of(schema: Json) -> Type:
    """A JSON schema in words, as "array of SessionAnswer" or "integer from 1 to 1000"."""
    if "$ref" in schema:
        return Type("", schema["$ref"].removeprefix(REFERENCE))
    if "anyOf" in schema:
        kinds = [type_of(each) for each in schema["anyOf"]]
        named = next((kind.schema for kind in kinds if kind.schema), "")
        plain = [kind.words for kind in kinds if not kind.schema]
        inner = next((kind.words for kind in kinds if kind.schema), "")
        return Type(" or ".join([*plain, inner] if named else plain), named)
    if "enum" in schema:
        return Type(" or ".join(str(each) for each in schema["enum"]))
    words = str(schema.get("type", "any value"))
    if words == "array":
        # The items of a tuple, which are of one type here, are in prefixItems.
        inner_type = type_of(schema.get("items") or schema.get("prefixItems", [{}])[0])
        return Type(f"array of {inner_type.words}", inner_type.schema)
    if words == "object" and isinstance(schema.get("additionalProperties"), Mapping):
        inner_type = type_of(schema["additionalProperties"])
        return Type(f"object of {inner_type.words}", inner_type.schema)
    return Type(f"{schema.get('format', words)}{_range(schema)}")


def _range(schema: Json) -> str:
    low, high, longest = (schema.get(name) for name in ("minimum", "maximum", "maxLength"))
    if low is not None and high is not None:
        return f" from {low} to {high}"
    if low is not None:
        return f" from {low}"
    if "exclusiveMinimum" in schema:
        return f" above {schema['exclusiveMinimum']}"
    return f" of at most {longest} characters" if longest is not None else ""


def _references(schema: Any) -> Iterator[str]:
    """The names of the schemas that `schema` refers to, in order."""
    if isinstance(schema, Mapping):
        if isinstance(schema.get("$ref"), str):
            yield schema["$ref"].removeprefix(REFERENCE)
        for each in schema.values():
            yield from _references(each)
    elif isinstance(schema, list):
        for each in schema:
            yield from _references(each)


def _with_nested(names: Sequence[str], schemas: Json) -> list[str]:
    """`names` and every schema nested in them, each once, outer ones first."""
    nested: dict[str, None] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop(0)
        if name not in nested:
            nested[name] = None
            waiting += _references(schemas[name].get("properties", {}))
    return list(nested)
