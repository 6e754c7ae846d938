"""A request as a shell command and as Python code, and JSON formatted for people."""

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote, urlencode

BODY_FILE = "body.json"
INLINE = 100  # longest body within the command, in characters; longer ones are in BODY_FILE
ROWS = 2  # of an array of objects
NUMBERS = 12  # of an array of numbers


@dataclass(frozen=True)
class Request:
    """A request. With `token`, the snippet reads a token from the environment."""

    method: str
    url: str
    token: bool
    headers: Mapping[str, str] = field(default_factory=dict)
    body: Any = None

    @property
    def inline(self) -> bool:
        """Whether the body is short enough to be part of the command."""
        return self.body is not None and len(json.dumps(self.body)) <= INLINE


def request_of(
    server: str, method: str, path: str, operation: Mapping[str, Any], places: Mapping[str, str] | None = None
) -> Request:
    """The example request of `operation`, a part of the OpenAPI document, to `server`.

    `places` has other values for its path parameters.
    """
    parameters = {(one["in"], one["name"]): one for one in operation.get("parameters", ())}
    for (where, name), one in parameters.items():
        if where == "path":
            value = (places or {}).get(name, one.get("example", ""))
            path = path.replace(f"{{{name}}}", quote(str(value)))
    query = {
        name: one["example"]
        for (where, name), one in parameters.items()
        if where == "query" and one.get("x-in-example")
    }
    headers = {
        name: str(one["example"])
        for (where, name), one in parameters.items()
        if where == "header" and one.get("x-in-example")
    }
    content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
    return Request(
        method=method,
        url=f"{server}{path}{'?' if query else ''}{urlencode(query)}",
        token=any(one and "installation_where_known" not in one for one in operation.get("security", ())),
        headers=headers | ({"Content-Type": "application/json"} if "example" in content else {}),
        body=content.get("example"),
    )


def curl(request: Request) -> str:
    """`request` as a curl command, one option per line."""
    parts = ["curl -sS"]
    if request.method not in ("GET", "POST") or (request.method == "POST" and request.body is None):
        parts.append(f"-X {request.method}")
    if request.token:
        parts.append('-H "Authorization: Bearer $TOKEN"')
    parts += [f"-H {shlex.quote(f'{name}: {value}')}" for name, value in request.headers.items()]
    if request.inline:
        parts.append(f"-d {shlex.quote(json.dumps(request.body))}")
    elif request.body is not None:
        parts.append(f"--data-binary @{BODY_FILE}")
    return " \\\n  ".join([*parts, shlex.quote(request.url)])


def python(request: Request) -> str:
    """`request` in Python, with the standard library only."""
    imports = ["import json"] if request.method == "GET" or request.body is not None else []
    arguments = [_quoted(request.url)]
    headers = [f"{_quoted(name)}: {_quoted(value)}" for name, value in request.headers.items()]
    if request.token:
        imports.append("import os")
        headers.insert(0, '"Authorization": f"Bearer {os.environ[\'TOKEN\']}"')
    lines = []
    if request.inline:
        lines.append(f"body = {_literal(request.body)}")
        arguments.append("data=json.dumps(body).encode()")
    elif request.body is not None:
        lines.append(f'with open("{BODY_FILE}", "rb") as file:\n    body = file.read()')
        arguments.append("data=body")
    if headers:
        arguments.append("headers={" + ", ".join(headers) + "}")
    arguments.append(f'method="{request.method}"')
    if "import json" not in imports:
        imports.insert(0, "import json")
    called = "\n".join(f"    {each}," for each in arguments)
    return "\n".join(
        [
            *imports,
            "from urllib.request import Request, urlopen",
            "",
            *lines,
            f"request = Request(\n{called}\n)",
            "with urlopen(request) as response:",
            "    content = response.read()",
            "answer = json.loads(content) if content else None",
        ]
    )


def _quoted(text: str) -> str:
    return json.dumps(text)


def _literal(value: Any) -> str:
    """JSON as Python writes it."""
    return repr(value).replace("'", '"')


def pretty_json(value: Any, indent: str = "") -> str:
    """`value` as formatted JSON: plain arrays on one line; long arrays cut, with the number left out."""
    deeper = f"{indent}  "
    if isinstance(value, Mapping) and value:
        members = [f"{deeper}{json.dumps(name)}: {pretty_json(each, deeper)}" for name, each in value.items()]
        return "{\n" + ",\n".join(members) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(each, dict | list) for each in value):
        rows = [f"{deeper}{pretty_json(each, deeper)}" for each in value[:ROWS]]
        if len(value) > ROWS:
            rows.append(f"{deeper}… {len(value) - ROWS} more")
        return "[\n" + ",\n".join(rows) + f"\n{indent}]"
    if isinstance(value, list):
        parts = [json.dumps(each, ensure_ascii=False) for each in value[:NUMBERS]]
        return (
            "["
            + ", ".join(parts + ([f"… {len(value) - NUMBERS} more"] if len(value) > NUMBERS else []))
            + "]"
        )
    return json.dumps(value, ensure_ascii=False)
