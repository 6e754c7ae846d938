"""Settings: the embedded default on one machine, anything larger by environment variables.

| variable | default | meaning |
|---|---|---|
| FRONTRUNNER_VAR | var | data folder; installed: the user's: database, broker, secret key, logs |
| FRONTRUNNER_PORT | 8000 | where `manage.py serve` listens |
| FRONTRUNNER_BIND | 127.0.0.1 | the address it listens on |
| FRONTRUNNER_HOSTS | (none) | comma-separated public host names; naming one switches HTTPS settings on |
| FRONTRUNNER_HTTPS | 1 with a public host, else 0 | 0 serves public hosts over plain HTTP (a lab's network) |
| FRONTRUNNER_SECRET_KEY | a file in the data folder | the key that signs sessions |
| DATABASE_URL | SQLite in the data folder | any database of dj-database-url; PostgreSQL is tested |
| CELERY_BROKER_URL | filesystem:// in the data folder | any Celery broker; Redis and RabbitMQ are tested |
| FRONTRUNNER_LOGS | text | json writes one object a line |
| DEBUG | 0 | Django's debug pages |
| FRONTRUNNER_RARE_BELOW | 5 | a model that fewer installations measured is shown as its chip; 1 names all |
| FRONTRUNNER_QUORUM | 3 | independent installations behind a confirmed figure; less for a private server |
| FRONTRUNNER_LIMITS | 1 | a factor of all limits on requests and on what is sent; 0: no limits |
| FRONTRUNNER_REQUIRE_TOTP | 0 | 1: the administration always needs a one-time password |
| FRONTRUNNER_SECOND_PERSON | 0 | 1: a front cannot be published by the people who drafted or submitted it |
| FRONTRUNNER_PROXIES | 1 with HTTPS, else 0 | proxies before the server that add to X-Forwarded-For |
| FRONTRUNNER_CACHE_URL | (none) | a Redis where several machines count requests together; else a file |
| FRONTRUNNER_BUCKET | (none) | s3://bucket/folder for open data and sequences; needs the extra `s3` |
| AWS_ACCESS_KEY_ID | (none) | the bucket's account: this and the next three are boto3's |
| AWS_SECRET_ACCESS_KEY | (none) | its password |
| AWS_DEFAULT_REGION | (none) | its region |
| AWS_ENDPOINT_URL | Amazon's | another service with the interface of S3 |
| FRONTRUNNER_WEB_THREADS | 4 | requests that a web process handles at a time; half write; 16 times wait |
| FRONTRUNNER_SOURCE | (none) | address of the source and documentation, to which the home page links |
| FRONTRUNNER_OPERATOR | (none) | who runs the server, for participants; shown on /about/ |
| FRONTRUNNER_CONTACT | (none) | whom they can ask: a mail address, or a page's; shown on /about/ |
| FRONTRUNNER_WATCHERS | (none) | networks that may read /metrics and /readyz, such as 10.0.0.5/32,fd00::/8 |
| SENTRY_DSN | (none) | where errors are reported; needs the extra `monitoring` |
| OTEL_EXPORTER_OTLP_ENDPOINT | (none) | who gets traces of requests and tasks; needs the extra `monitoring` |
| FRONTRUNNER_LEASE_SECONDS | 90 | without a heartbeat for so long, a measurement's worker counts as lost |
| FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS | 900 | for each sequence, after which a measurement fails |
"""

import os
from pathlib import Path

import dj_database_url
from csp.constants import NONE, SELF, UNSAFE_INLINE

from crowd.observability.environment import (
    bucket,
    choice,
    integer,
    make_writable_folder,
    matching,
    networks,
    secret_key,
    switch,
)
from groundwork import folders

BASE_DIR = Path(__file__).resolve().parent.parent


FRONTRUNNER_VAR = folders.data_folder()
FRONTRUNNER_PORT = integer("FRONTRUNNER_PORT", 8000)
FRONTRUNNER_BIND = os.environ.get("FRONTRUNNER_BIND", "127.0.0.1")
FRONTRUNNER_FRONTS = folders.FIXTURES / "fronts"
FRONTRUNNER_EXPLORATIONS = folders.FIXTURES / "explorations"
_bucket = bucket()
FRONTRUNNER_SEQUENCES = [folders.SEQUENCES, FRONTRUNNER_VAR / "sequences"]
if _bucket:
    FRONTRUNNER_SEQUENCES.append(FRONTRUNNER_VAR / "fetched")  # copies, made when they are needed
FRONTRUNNER_WEB_CLIENT = BASE_DIR / "client_kit" / "web"
# Requests of one installation, or of one address; 0: no limit.
_limits = integer("FRONTRUNNER_LIMITS", 1)
FRONTRUNNER_SUBMISSIONS_PER_MINUTE = 60 * _limits
FRONTRUNNER_OWN_REQUESTS_PER_MINUTE = 120 * _limits
FRONTRUNNER_ENROLMENTS_PER_HOUR = 120 * _limits
FRONTRUNNER_ATTEMPTS_PER_HOUR = 240 * _limits
FRONTRUNNER_READS_PER_MINUTE = 600 * _limits
FRONTRUNNER_PAGES_PER_MINUTE = 600 * _limits
# Readers of Parquet ask for dozens of ranges of one file.
FRONTRUNNER_RANGES_PER_MINUTE = 6000 * _limits
FRONTRUNNER_SOURCE = matching("FRONTRUNNER_SOURCE", "", r"(https?://.+)?", "https://host/project")
FRONTRUNNER_OPERATOR = matching("FRONTRUNNER_OPERATOR", "", r"[^\n<>]{0,200}", "The lab of your university")
FRONTRUNNER_CONTACT = matching(
    "FRONTRUNNER_CONTACT",
    "",
    r"(|[^@\s<>]+@[^@\s<>]+\.[^@\s<>]+|https?://[^\s<>]+)",
    "frontrunner@host.example, or https://host.example/contact",
)
FRONTRUNNER_WATCHERS = networks("FRONTRUNNER_WATCHERS")
# What one installation sends: bytes after gzip, values in them, growth of the database. Four times as much an
# address.
FRONTRUNNER_BYTES_PER_DAY = (16 << 20) * _limits
FRONTRUNNER_VALUES_PER_DAY = 2_000_000 * _limits
FRONTRUNNER_STORED_BYTES_PER_DAY = (5 << 20) * _limits
FRONTRUNNER_CACHE_URL = matching("FRONTRUNNER_CACHE_URL", "", r"((rediss?|unix)://.+)?", "redis://host/1")
FRONTRUNNER_CONSENT_VERSION = 2
FRONTRUNNER_QUORUM = integer("FRONTRUNNER_QUORUM", 3, least=1)
FRONTRUNNER_RARE_BELOW = integer("FRONTRUNNER_RARE_BELOW", 5, least=1)
FRONTRUNNER_EXPORTS_KEPT = 7  # nightly exports of the open data
# The function that measures an evaluation of an exploration.
FRONTRUNNER_EVALUATOR = "crowd.explorations.measuring.measurement.measure"
FRONTRUNNER_LEASE_SECONDS = integer("FRONTRUNNER_LEASE_SECONDS", 90, least=2)
# If a heartbeat came too late, the lease would go to another worker while its holder still measures.
FRONTRUNNER_HEARTBEAT_SECONDS = max(1, FRONTRUNNER_LEASE_SECONDS // 6)
# Between two searches for measurements whose worker or message was lost.
FRONTRUNNER_REAP_SECONDS = max(1, FRONTRUNNER_LEASE_SECONDS * 2 // 3)
FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS = integer("FRONTRUNNER_MEASUREMENT_TIMEOUT_SECONDS", 900, least=1)
# Limits of one request: the body as sent, and after gzip.
FRONTRUNNER_MAX_BODY_BYTES = 1 << 20
FRONTRUNNER_MAX_INFLATED_BYTES = 8 << 20
DATA_UPLOAD_MAX_MEMORY_SIZE = FRONTRUNNER_MAX_BODY_BYTES
# All bodies that one process holds, beyond 64 KiB of each. Limits of slow clients: docs/decisions/serving.md.
FRONTRUNNER_MAX_BODIES_BYTES = 64 << 20
FRONTRUNNER_BODY_SECONDS = 20  # for a body to arrive
FRONTRUNNER_SEND_SECONDS = 60  # in which a client must read something of an answer
FRONTRUNNER_WEB_THREADS = integer("FRONTRUNNER_WEB_THREADS", 4, least=1, most=64)
FRONTRUNNER_MAX_WAITING = 16 * FRONTRUNNER_WEB_THREADS  # requests that a process takes; more get 503

DEBUG = switch("DEBUG")
SECRET_KEY = os.environ.get("FRONTRUNNER_SECRET_KEY") or secret_key(FRONTRUNNER_VAR)

PUBLIC_HOSTS = [host.strip() for host in os.environ.get("FRONTRUNNER_HOSTS", "").split(",") if host.strip()]
ALLOWED_HOSTS = ["localhost", "127.0.0.1", "[::1]", *PUBLIC_HOSTS]
HTTPS = switch("FRONTRUNNER_HTTPS", default=bool(PUBLIC_HOSTS))

INSTALLED_APPS = [
    "crowd.operations",
    "crowd.dashboard",
    "crowd.demo",
    "crowd.audit",
    "crowd.fronts",
    "crowd.devices",
    "crowd.results",
    "crowd.predictions",
    "crowd.explorations",
    "crowd.administration.apps.AdministrationConfig",
    "django.contrib.auth",
    "django.contrib.contenttypes",
    "django.contrib.sessions",
    "django.contrib.messages",
    "whitenoise.runserver_nostatic",
    "django.contrib.staticfiles",
    "rest_framework",
    "drf_spectacular",
    "corsheaders",
    "csp",
    "django_otp",
    "django_otp.plugins.otp_totp",
]

MIDDLEWARE = [
    "crowd.http.middleware.RequestMiddleware",
    "corsheaders.middleware.CorsMiddleware",
    "django.middleware.security.SecurityMiddleware",
    "csp.middleware.CSPMiddleware",
    "crowd.http.middleware.LocalHostMiddleware",
    "crowd.http.middleware.BodyRefusalMiddleware",
    "crowd.http.middleware.NoNullMiddleware",
    "crowd.http.middleware.PageLimitMiddleware",
    "whitenoise.middleware.WhiteNoiseMiddleware",
    "django.contrib.sessions.middleware.SessionMiddleware",
    "django.middleware.common.CommonMiddleware",
    "django.middleware.csrf.CsrfViewMiddleware",
    "django.contrib.auth.middleware.AuthenticationMiddleware",
    "django_otp.middleware.OTPMiddleware",
    "django.contrib.messages.middleware.MessageMiddleware",
    "django.middleware.clickjacking.XFrameOptionsMiddleware",
]

ROOT_URLCONF = "crowd.urls"
WSGI_APPLICATION = "crowd.wsgi.application"
APPEND_SLASH = True

TEMPLATES = [
    {
        "BACKEND": "django.template.backends.django.DjangoTemplates",
        "DIRS": [BASE_DIR / "crowd" / "templates"],
        "APP_DIRS": True,
        "OPTIONS": {
            "context_processors": [
                "django.template.context_processors.request",
                "django.contrib.auth.context_processors.auth",
                "django.contrib.messages.context_processors.messages",
                "crowd.demo.mark.context",
            ],
        },
    },
]

DATABASES = {
    "default": dj_database_url.config(
        default=f"sqlite:///{FRONTRUNNER_VAR / 'frontrunner.sqlite3'}",
        conn_max_age=60,
        conn_health_checks=True,
    )
}
PATIENCE_SECONDS = 10  # for a locked database, unless the address says otherwise
if DATABASES["default"]["ENGINE"] == "django.db.backends.postgresql":
    # Without it, a request that waits for a lock could occupy its thread forever.
    DATABASES["default"].setdefault("OPTIONS", {}).setdefault(
        "options", f"-c lock_timeout={PATIENCE_SECONDS}s"
    )
    # Only the statements of crowd.database.prepared are prepared: Django writes values into all others.
    DATABASES["default"]["OPTIONS"].setdefault("prepare_threshold", 5)
if DATABASES["default"]["ENGINE"] == "django.db.backends.sqlite3":
    # WAL: readers never wait for the writer. IMMEDIATE: a writer takes its lock at the start, and waits for
    # it, instead of failing halfway.
    DATABASES["default"]["OPTIONS"] = {
        "timeout": PATIENCE_SECONDS,
        "transaction_mode": "IMMEDIATE",
        "init_command": "PRAGMA journal_mode=WAL;",
        **DATABASES["default"].get("OPTIONS", {}),
    }
DEFAULT_AUTO_FIELD = "django.db.models.BigAutoField"

CELERY_BROKER_URL = os.environ.get("CELERY_BROKER_URL", "filesystem://localhost")
if CELERY_BROKER_URL.startswith("filesystem://"):
    _queue = str(make_writable_folder(FRONTRUNNER_VAR / "broker" / "queue"))
    CELERY_BROKER_TRANSPORT_OPTIONS = {
        "data_folder_in": _queue,
        "data_folder_out": _queue,
        "control_folder": str(make_writable_folder(FRONTRUNNER_VAR / "broker" / "control")),
        "store_processed": False,
        "polling_interval": 0.02,
    }
elif CELERY_BROKER_URL.startswith(("redis://", "rediss://")):
    # A client waits for its response meanwhile. The sweep finds the work whose message was not sent.
    CELERY_BROKER_TRANSPORT_OPTIONS = {"socket_connect_timeout": 2}
# A worker that measures for minutes does not answer heartbeats: RabbitMQ would disconnect it.
CELERY_BROKER_HEARTBEAT = 0
CELERY_BROKER_CONNECTION_RETRY_ON_STARTUP = True
# By default Celery reconnects to the database for each task, which takes longer than most tasks. Instead,
# crowd.celery closes connections that are too old or broken.
CELERY_DB_REUSE_MAX = 1_000_000
CELERY_TASK_IGNORE_RESULT = True
CELERY_TASK_ACKS_LATE = True
CELERY_TASK_DEFAULT_QUEUE = "crowd"
CELERY_WORKER_PREFETCH_MULTIPLIER = 1
CELERY_WORKER_HIJACK_ROOT_LOGGER = False
CELERY_WORKER_ENABLE_REMOTE_CONTROL = False
CELERY_TIMEZONE = "UTC"
CELERY_BEAT_SCHEDULE: dict[str, dict[str, object]] = {
    "summarise what no message reached": {"task": "crowd.results.tasks.sweep", "schedule": 30.0},
    "write the open data when it is due": {"task": "crowd.results.tasks.export", "schedule": 300.0},
    "count rows for /metrics": {"task": "crowd.operations.tasks.count_rows", "schedule": 300.0},
    "learn the maps of devices when they are due": {
        "task": "crowd.predictions.tasks.rebuild",
        "schedule": 300.0,
    },
    "measure what no message reached": {
        "task": "crowd.explorations.tasks.reap",
        "schedule": FRONTRUNNER_REAP_SECONDS,
    },
}
CELERY_BEAT_SCHEDULER = "crowd.operations.periodic:Scheduler"
# A message expires when the next one is sent: a worker that was away finds one of each, not hundreds.
for _entry in CELERY_BEAT_SCHEDULE.values():
    _entry["options"] = {"expires": _entry["schedule"]}

AUTH_PASSWORD_VALIDATORS = [
    {"NAME": "django.contrib.auth.password_validation.UserAttributeSimilarityValidator"},
    {
        "NAME": "django.contrib.auth.password_validation.MinimumLengthValidator",
        "OPTIONS": {"min_length": 12},
    },
    {"NAME": "django.contrib.auth.password_validation.CommonPasswordValidator"},
    {"NAME": "django.contrib.auth.password_validation.NumericPasswordValidator"},
]
PASSWORD_HASHERS = [
    "django.contrib.auth.hashers.Argon2PasswordHasher",
    "django.contrib.auth.hashers.PBKDF2PasswordHasher",
]

LANGUAGE_CODE = "en-gb"
TIME_ZONE = "UTC"
USE_I18N = True
LANGUAGES = [("en-gb", "English"), ("de", "Deutsch"), ("fr", "Français")]
LOCALE_PATHS = [FRONTRUNNER_VAR / "locale"]  # compiled at each start
LANGUAGE_COOKIE_NAME = "language"
LANGUAGE_COOKIE_SECURE = HTTPS
USE_TZ = True

STATIC_URL = "/static/"
STATIC_ROOT = FRONTRUNNER_VAR / "static"
STATICFILES_FINDERS = [
    "django.contrib.staticfiles.finders.AppDirectoriesFinder",
    "crowd.dashboard.finders.LibraryFinder",
]
STORAGES: dict[str, dict[str, object]] = {
    "default": {"BACKEND": "django.core.files.storage.FileSystemStorage"},
    "staticfiles": {"BACKEND": "whitenoise.storage.CompressedManifestStaticFilesStorage"},
    "exports": {"BACKEND": "crowd.files.folder.Folder", "OPTIONS": {"name": "exports"}},
}
if _bucket:
    for _name in ("exports", "sequences"):
        STORAGES[_name] = {"BACKEND": "crowd.files.bucket.Bucket", "OPTIONS": {"url": _bucket, "name": _name}}
WHITENOISE_KEEP_ONLY_HASHED_FILES = True
# Django gives collected files more rights than the umask does.
FILE_UPLOAD_PERMISSIONS, FILE_UPLOAD_DIRECTORY_PERMISSIONS = 0o600, 0o700

REST_FRAMEWORK = {
    "DEFAULT_AUTHENTICATION_CLASSES": [],
    "DEFAULT_PERMISSION_CLASSES": [],
    "DEFAULT_RENDERER_CLASSES": ["rest_framework.renderers.JSONRenderer"],
    "DEFAULT_PARSER_CLASSES": [],
    "DEFAULT_SCHEMA_CLASS": "crowd.http.descriptions.ExplicitSchema",
    "EXCEPTION_HANDLER": "crowd.http.problems.exception_handler",
    "NUM_PROXIES": integer("FRONTRUNNER_PROXIES", int(HTTPS)),
    "UNAUTHENTICATED_USER": None,
}
SPECTACULAR_SETTINGS = {
    "TITLE": "Frontrunner",
    "DESCRIPTION": (
        "Pareto-optimal configurations of dense SLAM, and their speedups on the crowd's devices. Figures in "
        "examples come from a demo server."
    ),
    "VERSION": "1",
    "OAS_VERSION": "3.1.1",
    "SERVE_INCLUDE_SCHEMA": False,
    "POSTPROCESSING_HOOKS": ["crowd.api_pages.openapi.complete"],
}

CONTENT_SECURITY_POLICY = {
    "DIRECTIVES": {
        "default-src": [SELF],
        "base-uri": [NONE],
        "form-action": [SELF],
        "frame-ancestors": [NONE],
        "img-src": [SELF, "data:"],
        "object-src": [NONE],
        "script-src": [SELF],
        # Plotly sets style attributes on the elements that it draws. Style sheets are only our own.
        "style-src": [SELF],
        "style-src-attr": [UNSAFE_INLINE],
    }
}
# What pages of any other origin may read, never with a cookie. deploy/ has the same addresses.
CORS_URLS_REGEX = (
    r"^/(data/|tables/|sequences/|trajectories/|plans/|vectors/|explorations/[0-9]+/evaluations\.|api/v1/"
    r"(openapi\.json|(compare|devices|explorations|exports|fronts|models|runs|sessions|speedups)(/|$)))"
)
CORS_ALLOW_ALL_ORIGINS = True
CORS_ALLOW_CREDENTIALS = False
CORS_ALLOW_METHODS = ["GET", "HEAD", "OPTIONS"]
CORS_ALLOW_HEADERS = ["range", "if-none-match"]
CORS_EXPOSE_HEADERS = [
    "ETag", "Content-Range", "Accept-Ranges", "Content-Location", "Retry-After", "RateLimit",
    "RateLimit-Policy", "Link",
]  # fmt: skip
SECURE_CONTENT_TYPE_NOSNIFF = True
SECURE_REFERRER_POLICY = "same-origin"
X_FRAME_OPTIONS = "DENY"
# One-time passwords of the administration (RFC 6238). An account with a TOTP device always needs one.
FRONTRUNNER_REQUIRE_TOTP = switch("FRONTRUNNER_REQUIRE_TOTP")
FRONTRUNNER_SECOND_PERSON = switch("FRONTRUNNER_SECOND_PERSON")
OTP_TOTP_ISSUER = "Frontrunner"
OTP_ADMIN_HIDE_SENSITIVE_DATA = True
SESSION_COOKIE_HTTPONLY = True
SESSION_COOKIE_SECURE = HTTPS
CSRF_COOKIE_SECURE = HTTPS
CSRF_TRUSTED_ORIGINS = [f"{'https' if HTTPS else 'http'}://{host}" for host in PUBLIC_HOSTS]
if HTTPS:
    SECURE_SSL_REDIRECT = True
    SECURE_PROXY_SSL_HEADER = ("HTTP_X_FORWARDED_PROTO", "https")
    SECURE_HSTS_SECONDS = 365 * 24 * 3600
    SECURE_HSTS_INCLUDE_SUBDOMAINS = True
    # Browsers' preload lists hold whole domains for years: their owner decides that, not this program.
    SILENCED_SYSTEM_CHECKS = ["security.W021"]
    # The supervisor and a proxy's health check use plain HTTP, from this machine.
    SECURE_REDIRECT_EXEMPT = [r"^healthz$", r"^readyz$", r"^metrics$"]
elif not PUBLIC_HOSTS:
    # Only this machine reaches the server, over plain HTTP: HSTS, the redirect to HTTPS and Secure cookies
    # would lock its user out. With a public host, all of these checks run.
    SILENCED_SYSTEM_CHECKS = ["security.W004", "security.W008", "security.W012", "security.W016"]

FRONTRUNNER_LOGS = choice("FRONTRUNNER_LOGS", "text", "json")
LOGGING = {
    "version": 1,
    "disable_existing_loggers": False,
    "formatters": {
        "text": {"()": "crowd.observability.logs.TextFormatter"},
        "json": {"()": "crowd.observability.logs.JsonFormatter"},
    },
    "filters": {"without address": {"()": "crowd.observability.logs.WithoutAddress"}},
    "handlers": {"console": {"class": "logging.StreamHandler", "formatter": FRONTRUNNER_LOGS}},
    "root": {"handlers": ["console"], "level": "INFO"},
    # Our own log has the pattern of each request's address; these loggers would write the full address.
    "loggers": {
        "django.request": {"level": "ERROR", "filters": ["without address"]},
        "django.security.csrf": {"filters": ["without address"]},
        "botocore": {"level": "WARNING"},  # where it found its credentials
    },
}
