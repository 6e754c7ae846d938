"""The ASGI application that granian serves: `crowd.wsgi`, wrapped so that slow clients block no thread."""

from crowd.http.asgi_handler import Handler, raise_open_file_limit
from crowd.wsgi import application as django_application

raise_open_file_limit()
application = Handler(django_application)
