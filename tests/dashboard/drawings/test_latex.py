"""Tables as LaTeX: what TeX would interpret is escaped, numbers are readable, rules are those of booktabs."""

import re

import pytest
from django.test import Client

from crowd.dashboard.drawings.drawing import Table
from crowd.dashboard.drawings.latex import latex

TABLE = Table(
    ("device", "speedup", "ate_max_m", "confirmed"),
    [("A_1 & 50 %", 5.38812, 1.25e-7, True), ("B", None, -0.0125, False)],
)


def test_a_table_is_whole() -> None:
    assert latex(TABLE, "50 % of n", ["Speedup by\n device"]).splitlines() == [
        "% Speedup by device",
        r"% \usepackage{booktabs}",
        r"\begin{table}",
        r"\centering",
        r"\caption{50 \% of n}",
        r"\begin{tabular}{lrrl}",
        r"\toprule",
        r"device & speedup & ATE max (m) & confirmed \\",
        r"\midrule",
        r"A\_1 \& 50 \% & 5.388 & $1.25 \times 10^{-7}$ & yes \\",
        r"B & -- & $-0.0125$ & no \\",
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]


def test_numbers_of_a_column_have_the_same_digits() -> None:
    """Measured ones. Parameters stay as they are set."""
    lines = latex(Table(("speedup", "mu"), [(3.3904, 0.1), (1234.0, 0.05)]), "", []).splitlines()

    assert lines[-5:-3] == [r"3.390 & 0.1 \\", r"1234 & 0.05 \\"]


def test_a_table_longer_than_a_page_continues_on_the_next() -> None:
    lines = latex(Table(("a",), [("b",)] * 46), "All", []).splitlines()

    assert lines[:7] == [
        r"% \usepackage{booktabs,longtable}",
        r"\begin{longtable}{l}",
        r"\caption{All} \\",
        r"\toprule",
        r"a \\",
        r"\midrule",
        r"\endhead",
    ]
    assert lines[-2:] == [r"\bottomrule", r"\end{longtable}"]


def test_a_table_without_rows_has_its_head() -> None:
    assert r"\begin{tabular}{ll}" in latex(Table(("a", "b"), []), "", [])


@pytest.mark.django_db
@pytest.mark.usefixtures("session")
def test_a_page_offers_its_table_for_a_paper(client: Client) -> None:
    [address] = re.findall(r'href="(/tables/speedups\.tex[^"]*)"', client.get("/devices/").content.decode())

    answer = client.get(address)

    text = answer.content.decode()
    assert answer.headers["Content-Type"] == "application/x-tex; charset=utf-8"
    assert answer.headers["Content-Disposition"] == 'attachment; filename="frontrunner-speedups.tex"'
    assert text.startswith("% Speedup by device")
    assert "http://testserver/devices/" in text
    assert "no release of the open data yet" in text
    assert "Pixel 8" in text
    heads = "maker & model & processor & backend & speedup & low & high & sessions & installations & state"
    assert heads in text


@pytest.mark.django_db
@pytest.mark.usefixtures("session")
@pytest.mark.parametrize(
    ("by", "group"), [("vendor", "Mali"), ("soc", "Google Tensor G3"), ("backend", "OpenCL")]
)
def test_each_breakdown_is_a_table_for_a_paper(client: Client, by: str, group: str) -> None:
    answer = client.get(f"/tables/speedups/by/{by}.tex").content.decode()

    assert rf"{group} & 8 & " in answer
    assert r"\caption{Speedup by " in answer
    assert r"models & others & attempted & failing & losing \\" in answer
    assert r" & 1 & 0 & 1 & 0 & 0 \\" in answer
    assert client.get("/tables/speedups/by/shoe-size.tex").status_code == 404
