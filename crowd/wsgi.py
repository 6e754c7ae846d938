"""The WSGI application, which `crowd.asgi` wraps. Each process shares its metrics with the others."""

import os

from django.conf import settings
from django.core.wsgi import get_wsgi_application

from crowd.observability import metrics, reporting

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")

reporting.start()
application = get_wsgi_application()
metrics.registry.share(settings.FRONTRUNNER_VAR / "metrics", "web")
