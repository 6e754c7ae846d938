"""The API's pages for people: an index by topic, and for every call what the OpenAPI document says of it."""

import re

import pytest
from django.test import Client

from crowd.api_pages import calls, snippets
from crowd.api_pages.openapi import document
from crowd.api_pages.topics import TOPICS, codes_of, topic_of
from crowd.dashboard.templatetags.backticks import backticks
from crowd.http.codes import CODES

pytestmark = pytest.mark.django_db
DOCS = "/api/v1/docs"
KEYS = sorted(calls.operations(document()))


def test_the_index_leads_to_every_call_by_its_topic(client: Client) -> None:
    page = client.get(DOCS).content.decode()

    assert sorted(key for topic in TOPICS for key in topic.calls) == KEYS
    assert sorted(re.findall(rf'href="{DOCS}/([a-z_]+)"><code>', page)) == KEYS
    for topic in TOPICS:
        assert f"<h3>{topic.title}</h3>" in page


def test_a_page_of_a_call_says_all_that_the_document_does(client: Client) -> None:
    for key in KEYS:
        method, path, operation = calls.operations(document())[key]
        page = client.get(f"{DOCS}/{key}").content.decode()
        assert f"<code>{method} {path}</code></h1>" in page
        for parameter in operation.get("parameters", ()):
            assert f"<dt><code>{parameter['name']}</code>" in page, (key, parameter["name"])
        for code in operation["x-codes"]:
            assert f'href="{DOCS}#code-{code}"' in page, (key, code)
        anchors = re.findall(r'href="#([^"]+)"', page)
        assert [anchor for anchor in anchors if f'id="{anchor}"' not in page] == [], key
        assert re.findall(r'(?:src|href)="(?:https?:)?//[^"]*', page) == [], key
        assert "`" not in page.split("<main")[1], key


def test_a_call_that_does_not_exist_has_no_page(client: Client) -> None:
    assert client.get(f"{DOCS}/nothing").status_code == 404


def test_every_code_of_a_call_is_known() -> None:
    for key in KEYS:
        assert set(codes_of(key)) <= CODES.keys()
    with pytest.raises(KeyError, match="nothing has no topic"):
        topic_of("nothing")


@pytest.mark.parametrize(
    ("schema", "words", "name"),
    [
        ({"type": "integer", "minimum": 1, "maximum": 1000}, "integer from 1 to 1000", ""),
        ({"type": "number", "exclusiveMinimum": 0}, "number above 0", ""),
        ({"type": "string", "maxLength": 200}, "string of at most 200 characters", ""),
        ({"type": "string", "format": "uuid"}, "uuid", ""),
        ({"enum": ["0", "1"]}, "0 or 1", ""),
        ({"anyOf": [{"type": "number"}, {"type": "null"}]}, "number or null", ""),
        ({"type": "array", "items": {"$ref": "#/components/schemas/Run"}}, "array of ", "Run"),
        ({"anyOf": [{"$ref": "#/components/schemas/Run"}, {"type": "null"}]}, "null or ", "Run"),
        ({"type": "object", "additionalProperties": {"type": "number"}}, "object of number", ""),
    ],
)
def test_a_type_is_said_in_words(schema: dict[str, object], words: str, name: str) -> None:
    assert calls.type_of(schema) == calls.Type(words, name)


def test_long_arrays_are_cut_and_say_so() -> None:
    assert snippets.pretty_json(list(range(14))).endswith("10, 11, … 2 more]")
    assert (
        snippets.pretty_json({"rows": [{}, {}, {}]})
        == '{\n  "rows": [\n    {},\n    {},\n    … 1 more\n  ]\n}'
    )


def test_names_between_backticks_are_code_and_nothing_else_is() -> None:
    assert backticks("see `next` & <b>") == "see <code>next</code> &amp; &lt;b&gt;"
    assert backticks("a lone ` stays") == "a lone ` stays"
