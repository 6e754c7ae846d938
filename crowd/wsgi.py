"""The WSGI application, which `crowd.asgi` wraps. Each process shares its request counts with the others."""

import os

from django.conf import settings
from django.core.wsgi import get_wsgi_application

from crowd.observability import metrics

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "crowd.settings")

application = get_wsgi_application()
metrics.requests.share(settings.FRONTRUNNER_VAR / "metrics")
