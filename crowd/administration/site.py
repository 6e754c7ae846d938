"""The administration as an application, in a module of its own: it is read before any model may be."""

from django.contrib.admin.apps import AdminConfig


class Administration(AdminConfig):
    """django.contrib.admin with the first page of crowd.administration.first_page."""

    default_site = "crowd.administration.first_page.Site"
