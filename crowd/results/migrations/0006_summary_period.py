"""The figures of a period are read from one index alone."""

from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('results', '0005_session_description'),
    ]

    operations = [
        migrations.RemoveIndex(
            model_name='sessionsummary',
            name='summary_started_at',
        ),
        migrations.AddIndex(
            model_name='sessionsummary',
            index=models.Index(condition=models.Q(('counted', True)), fields=['configuration', 'cohort', 'baseline', 'installation', 'state', 'started_at', 'log_ratio', 'ate_max', 'counted'], name='summary_period'),
        ),
    ]
