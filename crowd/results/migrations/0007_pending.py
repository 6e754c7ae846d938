"""Runs that no task has judged yet are pending."""
from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('results', '0006_summary_period'),
    ]

    operations = [
        migrations.AlterField(
            model_name='devicespeedup',
            name='state',
            field=models.CharField(choices=[('pending', 'Pending'), ('valid', 'Valid'), ('suspect', 'Suspect'), ('invalid', 'Invalid'), ('quarantined', 'Quarantined')], help_text='suspect: no valid session, only suspect ones', max_length=16),
        ),
        migrations.AlterField(
            model_name='run',
            name='state',
            field=models.CharField(choices=[('pending', 'Pending'), ('valid', 'Valid'), ('suspect', 'Suspect'), ('invalid', 'Invalid'), ('quarantined', 'Quarantined')], max_length=16),
        ),
        migrations.AlterField(
            model_name='sessionsummary',
            name='state',
            field=models.CharField(choices=[('pending', 'Pending'), ('valid', 'Valid'), ('suspect', 'Suspect'), ('invalid', 'Invalid'), ('quarantined', 'Quarantined')], max_length=16),
        ),
    ]
