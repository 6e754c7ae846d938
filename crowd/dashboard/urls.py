"""URL patterns of the pages, at the root of the site, and of their drawings."""

from django.urls import path

from crowd.dashboard.drawings import DRAWINGS
from crowd.dashboard.drawings.serving import url_patterns
from crowd.dashboard.views import (
    cards,
    compare,
    devices,
    downloads,
    explorations,
    fronts,
    home,
    measure,
    private_page,
    reading,
    recommend,
    search,
    sessions,
    surface,
    transfer,
)

app_name = "dashboard"

urlpatterns = [
    path("", home.home, name="home"),
    path("measure/", measure.measure, name="measure"),
    path("measure/key/", measure.key, name="key"),
    path("measure/<str:name>", measure.client_file, name="client-file"),
    path("devices/", devices.devices, name="devices"),
    path("devices/<slug:slug>/", devices.device, name="device"),
    path("devices/<slug:slug>/card.png", cards.device_card, name="device-card"),
    path("card.png", cards.crowd_card, name="card"),
    path("search/", search.search, name="search"),
    path("compare/", compare.compare, name="compare"),
    path("mine/<str:signed>/", private_page.mine, name="mine"),
    path("sessions/<uuid:uuid>/", sessions.session, name="session"),
    path("runs/<uuid:uuid>/", sessions.run, name="run"),
    path("fronts/", fronts.fronts, name="fronts"),
    path("fronts/<str:slug>/", fronts.front, name="front"),
    path("explorations/", explorations.explorations, name="explorations"),
    path("explorations/<int:key>/", explorations.exploration, name="exploration"),
    path("explorations/<int:key>/live/", explorations.exploration_live, name="exploration-live"),
    path("explorations/<int:key>/evaluations.csv", downloads.evaluations_csv, name="evaluations-csv"),
    path("explorations/<int:key>/evaluations.json", downloads.evaluations_json, name="evaluations-json"),
    path("recommend/", recommend.recommend, name="recommend"),
    path("transfer/", transfer.transfer, name="transfer"),
    path("surface/", surface.surface, name="surface"),
    path("data/", reading.data, name="data"),
    path("data/<str:name>/", reading.export, name="export"),
    path("about/", reading.about, name="about"),
    *(address for drawing in DRAWINGS for address in url_patterns(drawing)),
]
