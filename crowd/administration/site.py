"""The administration as an application, in a module of its own: it is read before any model may be."""

from django.contrib.admin.apps import AdminConfig


class Administration(AdminConfig):
    """django.contrib.admin with the log-in of crowd.access.logins."""

    default_site = "crowd.access.logins.Site"
