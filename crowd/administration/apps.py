"""Django's configuration of the administration. Django reads it before models can be imported."""

from django.contrib.admin.apps import AdminConfig


class AdministrationConfig(AdminConfig):
    """django.contrib.admin with the site of crowd.administration.site."""

    default_site = "crowd.administration.site.AdministrationSite"
