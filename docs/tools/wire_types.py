"""Writes what the browser's client takes from `wire`: types (wire.d.ts) and constants (constants.js).

python -m docs.tools.wire_types
"""

import json
from pathlib import Path
from typing import Any

import msgspec

from wire import protocol, session, session_statistics
from wire.manifest import Manifest
from wire.session import Enrolment, Submission

WEB = Path(__file__).parents[2] / "client_kit/web"
HEAD = "/* From the package `wire`. Written by docs/tools/wire_types.py: do not edit. */\n"
CONSTANTS = {
    protocol: ("LEAST_PAIRS", "MOST_LOST"),
    session: ("SCHEMA_VERSION",),
    session_statistics: (
        "LEAST_DEVIATION",
        "QUANTILES_95",
        "QUANTILES_99",
        "SLOWDOWN_LEVEL",
        "WIDEST_INTERVAL",
    ),
}
OTHER_NAMES = {"integer": "number"}


def constants() -> str:
    """The content of constants.js."""
    values = {name: getattr(module, name) for module, names in CONSTANTS.items() for name in names}
    return f"{HEAD}\n" + "".join(
        f"export const {name} = {json.dumps(values[name])};\n" for name in sorted(values)
    )


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


FILES = {"constants.js": constants, "wire.d.ts": declarations}

if __name__ == "__main__":
    for name, content in FILES.items():
        (WEB / name).write_text(content(), encoding="utf-8")
