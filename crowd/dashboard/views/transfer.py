"""The page about transfer: the reference's fastest on each device, and similarity of devices."""

import numpy as np
from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse
from django.shortcuts import render

from crowd.dashboard.content.judgements import judgements, maps_of
from crowd.dashboard.content.transfer import KINDS, ordered, pairs, similarities
from crowd.dashboard.drawings.transfer import kind_of
from crowd.dashboard.figures import findings
from crowd.dashboard.figures.transfer import REGRET_HEIGHT, correlation_height, winners_height
from crowd.dashboard.filtering import Filtering, filtered
from crowd.results.reading import selectors as results
from crowd.results.reading.transferring import correlations

PAGE = 50
JUDGED = 50  # most recommendations in the table
RUNGS = ("power", "stages", "devices")  # models of the ladder, simplest first


@filtered
def transfer(request: HttpRequest, asked: Filtering) -> HttpResponse:
    """Winners, correlations and judgements, with the filters of the query string."""
    winners = results.winners(asked.filters)
    matrix = correlations.correlation_matrix(asked.filters)
    kind = kind_of(request)
    every = pairs(matrix, kind)
    return render(
        request,
        "dashboard/transfer.html",
        {
            "asked": asked,
            "query": asked.query,
            "found": winners,
            "part": Paginator(ordered(winners.rows), PAGE).get_page(request.GET.get("page")),
            "matrix": matrix,
            "kind": kind,
            "kinds": [(name, asked.with_other("correlation", name)) for name in KINDS],
            "alike": similarities(matrix, kind),
            "pairs": len(every),
            "findings": {
                "regret": findings.regret(winners),
                "winners": findings.winners(winners.counts, len(winners.rows)),
                "alike": findings.alike(every.tolist(), kind),
            },
            "regret_height": REGRET_HEIGHT,
            "median": float(np.median(every)) if len(every) else None,
            "height": correlation_height(len(matrix.devices)),
            "winners_height": winners_height(len(winners.counts)),
            "judged": judgements(winners.front) if winners.front else None,
            "judged_rows": JUDGED,
            "judged_slice": f":{JUDGED}",
            "rungs": RUNGS,
            "maps": maps_of(winners.front) if winners.front else None,
        },
    )
