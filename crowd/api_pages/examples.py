"""An example of every call: a request, and what a demo server answered.

`tests/snapshots/test_api_examples.py` writes examples.json, and checks it against a server.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

from crowd.api_pages.meanings import meaning, parameter_meaning
from crowd.api_pages.topics import TOPICS, codes_of, topic_of

FILE = Path(__file__).with_name("examples.json")
# Examples of parameters that no example request uses.
PARAMETERS: dict[str, Any] = {
    "application": "kfusion",
    "backend": "opencl",
    "configuration": "best",
    "confirmed": "1",
    "cursor": "",
    "device": "Simulated",
    "front": "kfusion-test",
    "gpu": "Adreno",
    "maker": "Samsung",
    "max_ate": 0.05,
    "max_ms": 200,
    "min_sessions": 1,
    "minutes": 2,
    "os": "Android",
    "simulated": "1",
    "since": "2026-01-01",
    "soc": "Snapdragon",
    "suspect": "0",
    "until": "2026-12-31",
    "valid": "1",
    "vendor": "Adreno",
    "Content-Encoding": "gzip",
}


@cache
def examples() -> dict[str, dict[str, Any]]:
    """The examples by operation id.

    Each has `status`, and may have `path`, `query`, `headers`, `body` and `answer`. `parameters` holds
    examples of parameters that the request does not use.
    """
    by_operation: dict[str, dict[str, Any]] = json.loads(FILE.read_text())
    return by_operation


def describe(document: dict[str, Any]) -> None:
    """Add topics, codes, examples and the meanings of members to `document`."""
    for methods in document["paths"].values():
        for operation in methods.values():
            key = operation["operationId"]
            operation["tags"] = [topic_of(key).title]
            operation["x-codes"] = list(codes_of(key))
            if key in examples():
                _add_example(operation, examples()[key])
    for name, schema in document["components"]["schemas"].items():
        for member, each in schema.get("properties", {}).items():
            if text := meaning(name, member):
                each.setdefault("description", text)
    document["tags"] = [{"name": topic.title, "description": topic.purpose} for topic in TOPICS]


def _add_example(operation: dict[str, Any], example: dict[str, Any]) -> None:
    used = example.get("path", {}) | example.get("query", {}) | example.get("headers", {})
    others = PARAMETERS | example.get("parameters", {})
    for parameter in operation.get("parameters", ()):
        name = parameter["name"]
        if text := parameter_meaning(name):
            parameter.setdefault("description", text)
        parameter["x-in-example"] = name in used
        parameter["example"] = used.get(name, others.get(name, ""))
    if "body" in example:
        operation["requestBody"]["content"]["application/json"]["example"] = example["body"]
    if "answer" in example:
        response = operation["responses"][str(example["status"])]
        response["content"]["application/json"]["example"] = example["answer"]
