"""Writes client_kit/web/wire.d.ts, the types of the browser's client, from the structs of `wire`.

python -m docs.tools.wire_types
"""

import json
from pathlib import Path
from typing import Any

import msgspec

from wire.manifest import Manifest
from wire.session import Enrolment, Submission

FILE = Path(__file__).parents[2] / "client_kit/web/wire.d.ts"
HEAD = "/* What travels, from the structs of `wire`. Written by docs/tools/wire_types.py: do not edit. */\n"
OTHER_NAMES = {"integer": "number"}


def declarations() -> str:
    """The content of wire.d.ts: an interface for each struct, in alphabetical order."""
    _, schemas = msgspec.json.schema_components([Manifest, Submission, Enrolment], ref_template="{name}")
    return HEAD + "".join(f"\n{_interface(name, schemas[name])}" for name in sorted(schemas))


def _interface(name: str, schema: dict[str, Any]) -> str:
    [summary, *_] = schema["description"].split("\n\n")
    members = [
        f"  {member}{'' if _is_present(member, schema) else '?'}: {_type(described)};\n"
        for member, described in schema["properties"].items()
    ]
    return f"/** {' '.join(summary.split())} */\nexport interface {name} {{\n{''.join(members)}}}\n"


def _is_present(member: str, schema: dict[str, Any]) -> bool:
    """Whether `member` is always there: the programs that send it write a default other than null."""
    return member in schema["required"] or schema["properties"][member].get("default") is not None


def _type(schema: dict[str, Any]) -> str:
    """The type of a value that `schema` describes."""
    if "$ref" in schema:
        return str(schema["$ref"])
    if "enum" in schema:
        return " | ".join(map(json.dumps, schema["enum"]))
    if "anyOf" in schema:
        return " | ".join(dict.fromkeys(_type(one) for one in schema["anyOf"]))
    match schema.get("type"):
        case None:
            return "unknown"
        case "array":
            item = _type(schema["items"])
            return f"({item})[]" if "|" in item else f"{item}[]"
        case "object":
            values = schema.get("additionalProperties")
            return f"Record<string, {_type(values) if isinstance(values, dict) else 'unknown'}>"
        case kind:
            return OTHER_NAMES.get(kind, kind)


if __name__ == "__main__":
    FILE.write_text(declarations(), encoding="utf-8")
