"""The pages, at the root of the site, and the figures that they draw."""

from django.urls import path

from crowd.dashboard import charts, downloads, own_views
from crowd.dashboard.views import devices, explorations, fronts, home, reading, sessions

app_name = "dashboard"

urlpatterns = [
    path("", home.home, name="home"),
    path("devices/", devices.devices, name="devices"),
    path("devices/<slug:slug>/", devices.device, name="device"),
    path("compare/", devices.compare, name="compare"),
    path("mine/<str:signed>/", own_views.mine, name="mine"),
    path("sessions/<uuid:uuid>/", sessions.session, name="session"),
    path("runs/<uuid:uuid>/", sessions.run, name="run"),
    path("fronts/", fronts.fronts, name="fronts"),
    path("fronts/<str:slug>/", fronts.front, name="front"),
    path("explorations/", explorations.explorations, name="explorations"),
    path("explorations/<int:key>/", explorations.exploration, name="exploration"),
    path("explorations/<int:key>/live/", explorations.exploration_live, name="exploration-live"),
    path("explorations/<int:key>/evaluations.csv", downloads.evaluations_csv, name="evaluations-csv"),
    path("explorations/<int:key>/evaluations.json", downloads.evaluations_json, name="evaluations-json"),
    path("data/", reading.data, name="data"),
    path("about/", reading.about, name="about"),
    path("figures/speedups.json", charts.speedups, name="speedups-figure"),
    path("figures/compare.json", charts.compare, name="compare-figure"),
    path("figures/sessions/<uuid:uuid>/frames.json", charts.session_frames, name="session-frames-figure"),
    path("figures/sessions/<uuid:uuid>/stages.json", charts.session_stages, name="session-stages-figure"),
    path("figures/runs/<uuid:uuid>/stages.json", charts.run_stages, name="run-stages-figure"),
    path("figures/explorations/<int:key>.json", charts.exploration, name="exploration-figure"),
    path(
        "figures/explorations/<int:key>/hypervolume.json",
        charts.exploration_hypervolume,
        name="exploration-hypervolume-figure",
    ),
    path(
        "figures/explorations/<int:key>/importance.json",
        charts.exploration_importance,
        name="exploration-importance-figure",
    ),
    path(
        "figures/explorations/<int:key>/predictions/<slug:objective>.json",
        charts.exploration_predictions,
        name="exploration-predictions-figure",
    ),
    path("figures/fronts/<str:slug>.json", charts.front, name="front-figure"),
]
