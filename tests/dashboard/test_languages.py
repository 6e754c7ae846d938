"""The participants' pages in other languages: complete catalogues, and the language of each answer."""

import ast
import io
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from babel.messages.catalog import Catalog
from babel.messages.mofile import read_mo
from babel.messages.pofile import read_po
from django.conf import settings as django_settings
from django.http import HttpResponse
from django.template.engine import Engine
from django.templatetags.i18n import BlockTranslateNode, TranslateNode
from django.test import Client
from django.utils.translation import override

from crowd.dashboard import formats
from crowd.dashboard.catalogues import CATALOGUES, compile_catalogues
from crowd.dashboard.content.confirmation import NUMBERS
from crowd.dashboard.languages import module_sentences
from crowd.dashboard.templatetags.pages import navigation
from crowd.devices.models import Installation
from crowd.predictions.probe_assignment import TEACHES
from crowd.results.models import State
from crowd.results.privacy.own_page import own_page_path
from crowd.results.validity.rules import RULES
from tests.builders.documents import submission_document
from tests.builders.participant import Participant
from tests.client_kit.web.deno import DENO

DASHBOARD = CATALOGUES.parent
WEB = Path(django_settings.FRONTRUNNER_WEB_CLIENT)
# (language, catalogue) of each that is here; English needs none.
SOURCES = {path.parts[-3]: path.read_text(encoding="utf-8") for path in CATALOGUES.glob("*/*/django.po")}
# What templates and views translate without naming it.
VARIABLE = {
    *(rule.words for rule in RULES.values()),
    *(item.name for item in navigation({})),
    *NUMBERS.values(),
    *(state.value for state in State if state != State.PENDING),
    "unconfirmed",
    TEACHES,
}
KEPT = re.compile(r"%\(\w+\)s|%%|<[^>]*>")


def in_templates() -> Iterator[tuple[str, str]]:
    """Each sentence of the templates, with its plural or ""."""
    engine = Engine.get_default()
    for path in (DASHBOARD / "templates").rglob("*.html"):
        nodes = engine.from_string(path.read_text(encoding="utf-8")).nodelist
        for node in nodes.get_nodes_by_type(TranslateNode):
            if (text := node.filter_expression.var.literal) is not None:
                yield text.replace("%", "%%"), ""
        for block in nodes.get_nodes_by_type(BlockTranslateNode):
            texts = [
                block.render_token_list(tokens)[0] for tokens in (block.singular, block.plural) if tokens
            ]
            yield texts[0], "".join(texts[1:])


def in_python() -> Iterator[tuple[str, str]]:
    for path in DASHBOARD.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                texts = [str(arg.value) for arg in node.args[:2] if isinstance(arg, ast.Constant)]
                if texts and node.func.id == "gettext":
                    yield texts[0], ""
                elif len(texts) == 2 and node.func.id == "ngettext":
                    yield texts[0], texts[1]


def entries(source: str) -> dict[str, str]:
    """The translations of a catalogue by sentence. A NUL separates plurals and further forms."""
    found = forms(read_po(io.StringIO(source), abort_invalid=True))
    return {"\0".join(sentences): "\0".join(translations) for sentences, translations in found.items()}


def forms(catalogue: Catalog) -> dict[tuple[str, ...], tuple[str, ...]]:
    """The translations of a catalogue by sentence; both are several where there is a number."""
    return {tuple_of(message.id): tuple_of(message.string) for message in catalogue if message.id}


def tuple_of(text: Any) -> tuple[str, ...]:
    return (text,) if isinstance(text, str) else tuple(text)


def test_every_language_of_the_settings_has_a_catalogue() -> None:
    assert {code for code, _ in django_settings.LANGUAGES} == {"en-gb", *SOURCES}


@pytest.fixture(scope="module")
def used() -> set[str]:
    """The keys of a complete catalogue."""
    sentences = {*in_templates(), *in_python(), *module_sentences(WEB), *((text, "") for text in VARIABLE)}
    return {f"{one}\0{more}" if more else one for one, more in sentences}


@pytest.mark.parametrize("language", SOURCES)
def test_a_catalogue_has_each_sentence_that_is_used_and_no_other(language: str, used: set[str]) -> None:
    translations = entries(SOURCES[language])
    lacking = {key for key in used if not all(translations.get(key, "").split("\0"))}

    assert sorted(lacking) == []
    assert sorted(set(translations) - used) == []


@pytest.mark.parametrize("language", SOURCES)
def test_a_translation_has_the_placeholders_and_tags_of_its_sentence(language: str) -> None:
    wrong = []
    for key, translation in entries(SOURCES[language]).items():
        sentence, written = key.split("\0"), translation.split("\0")
        # Languages with more forms need more of client_kit/web/language.js.
        assert len(written) == len(sentence), key
        known = {frozenset(KEPT.findall(text)) for text in sentence}
        if {frozenset(KEPT.findall(text)) for text in written} - known:
            wrong.append((key, translation))
    assert wrong == []


@pytest.mark.parametrize("language", SOURCES)
def test_a_catalogue_is_compiled_where_django_reads_it(settings: Any, tmp_path: Path, language: str) -> None:
    settings.LOCALE_PATHS = [tmp_path]
    compiled = tmp_path / language / "LC_MESSAGES" / "django.mo"
    compiled.parent.mkdir(parents=True)
    compiled.write_bytes(b"of an older version")

    compile_catalogues()

    with compiled.open("rb") as file:
        assert forms(read_mo(file)) == forms(read_po(io.StringIO(SOURCES[language]), abort_invalid=True))
    assert "#, fuzzy" not in SOURCES[language]


def test_modules_write_each_sentence_where_it_is_translated() -> None:
    """Anything else would be missed by the search for sentences, except what the server sends."""
    other = [
        (path.name, call)
        for path in WEB.glob("*.js")
        for call in re.findall(r'(?<!function )\bn?gettext\((?!\s*").*', path.read_text(encoding="utf-8"))
    ]
    assert other == [("probes.js", "gettext(why) });")]


def ask(client: Client, address: str, accepted: str) -> HttpResponse:
    answer: Any = client.get(address, headers={"Accept-Language": accepted, "X-Request-ID": "languages"})
    return answer


@pytest.mark.parametrize(
    ("accepted", "language", "words"),
    [
        ("", "en", "Measure this device"),
        ("en-US,de;q=0.5", "en", "Measure this device"),
        ("de-AT,en;q=0.5", "de", "Dieses Gerät messen"),
        ("fr-CA,de;q=0.5", "fr", "Mesurer cet appareil"),
        ("xx", "en", "Measure this device"),
    ],
)
@pytest.mark.parametrize("address", ["/measure/", "/measure/key/"])
def test_the_browser_asks_for_its_language(
    client: Client, db: None, address: str, accepted: str, language: str, words: str
) -> None:
    answer = ask(client, address, accepted)
    text = answer.content.decode()

    assert answer.headers["Content-Language"] == language
    assert {"Accept-Language", "Cookie"} <= set(answer.headers["Vary"].split(", "))
    assert f'<html lang="{language}">' in text
    assert ('id="translations"' in text) == (language != "en")
    if address == "/measure/":
        assert f"<h1>{words}</h1>" in text
    assert "Set-Cookie" not in answer.headers


def test_a_choice_is_kept(client: Client, db: None) -> None:
    chosen = ask(client, "/measure/?language=de", "en")
    kept = ask(client, "/measure/key/", "en")
    back = ask(client, "/measure/?language=en", "de")

    assert chosen.headers["Content-Language"] == kept.headers["Content-Language"] == "de"
    assert chosen.cookies["language"]["samesite"] == "Lax"
    assert back.headers["Content-Language"] == "en"
    assert ask(client, "/measure/", "de").headers["Content-Language"] == "en"


def test_an_unknown_choice_is_ignored_and_languages_have_their_own_names(client: Client, db: None) -> None:
    answer = ask(client, "/measure/?language=klingon", "de")

    page = answer.content.decode()
    assert answer.headers["Content-Language"] == "de"
    assert not answer.cookies
    links = re.findall(r'<a href="\?language=(..)"[^>]*>(\w+)</a>', page)
    assert links == [("en", "English"), ("fr", "Français")]
    # One text of the consent is binding.
    assert "Verbindlich ist der englische Text der Einwilligung." in page
    assert "binding" not in ask(client, "/measure/key/", "de").content.decode()
    assert "binding" not in ask(client, "/measure/", "en").content.decode()


@pytest.mark.parametrize(
    "address", ["/", "/about/", "/devices/", "/nothing/", "/api/v1/nothing", "/api/v1/docs"]
)
def test_everything_else_stays_english(client: Client, db: None, address: str) -> None:
    english, german = ask(client, address, "en"), ask(client, address, "de")

    assert german.content == english.content
    assert "Content-Language" not in german.headers


def test_the_private_page_is_in_the_language_until_it_is_erased(
    client: Client, front: Any, participant: Participant
) -> None:
    participant.submit(submission_document())
    path = own_page_path(Installation.objects.get())
    page = ask(client, path, "de")
    participant.delete("/me")
    gone = ask(client, path, "de")

    text = page.content.decode()
    assert '<html lang="de">' in text
    assert "1&nbsp;Sitzung Ihrer Installation." in text
    assert re.search(rf"\b\d,\d\d{formats.TIMES}", text)
    assert "no-store" in page.headers["Cache-Control"]
    assert (gone.status_code, gone.headers["Content-Language"]) == (404, "de")
    assert "Unter dieser Adresse gibt es nichts." in gone.content.decode()


@pytest.mark.parametrize(
    ("language", "sentences"),
    [
        ("en", "About a minute left; 0 probes; 1 probe; 8.40 ms a frame"),
        (
            "de",
            "Noch etwa eine Minute; 0 weitere Konfigurationen; 1 weitere Konfiguration; 8,40 ms pro Bild",
        ),
        (
            "fr",
            "Encore une minute environ; 0 configuration de plus; 1 configuration de plus; 8,40 ms par image",
        ),
    ],
)
def test_modules_speak_the_language_of_their_page(
    client: Client, db: None, tmp_path: Path, language: str, sentences: str
) -> None:
    page = ask(client, "/measure/", language).content.decode()
    given = re.search(r'<script id="translations" type="application/json">(.*?)</script>', page)
    script = tmp_path / "said.js"
    script.write_text(
        f"""
        globalThis.document = {{
            documentElement: {{ lang: {json.dumps(language)} }},
            getElementById: () => ({json.dumps(given and {"textContent": given[1]})}),
        }};
        const {{ decimal, gettext, ngettext }} = await import({json.dumps((WEB / "language.js").as_uri())});
        const probes = (number) => ngettext("%(number)s probe", "%(number)s probes", number, {{ number }});
        console.log([
            ngettext("About a minute left", "About %(number)s minutes left", 1, {{ number: 1 }}),
            probes(0), probes(1),
            gettext("%(time)s ms a frame", {{ time: decimal("8.40") }}),
        ].join("; "));
        """,
        encoding="utf-8",
    )
    ended = subprocess.run([DENO, "run", "--allow-read", script], capture_output=True, text=True, check=False)

    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == f"{sentences}\n"


def test_numbers_have_the_separators_of_the_language() -> None:
    assert formats.speedup(8.4) == "8.40" + formats.TIMES
    with override("de"):
        assert formats.speedup(8.4) == "8,40" + formats.TIMES
        assert formats.count(12345) == "12.345"
        assert formats.change(1.034) == "+3,4\N{NARROW NO-BREAK SPACE}%"
        assert formats.centimetres(0.0123) == "1,23\N{NARROW NO-BREAK SPACE}cm"
