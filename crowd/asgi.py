"""The ASGI application that granian serves: `crowd.wsgi`, where slow clients cost no thread."""

from crowd.http.asgi_handler import Handler, allow_open_files
from crowd.wsgi import application as django_application

allow_open_files()
application = Handler(django_application)
