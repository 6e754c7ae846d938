"""The mark of a demo server."""

from django.db import models


class DemoMark(models.Model):
    """The only row marks this database as that of a demo server. It comes first and never changes."""

    marked_at = models.DateTimeField(auto_now_add=True)

    class Meta:
        constraints = [models.CheckConstraint(condition=models.Q(pk=1), name="one_demo_mark")]

    def __str__(self) -> str:
        return f"demo since {self.marked_at}"
