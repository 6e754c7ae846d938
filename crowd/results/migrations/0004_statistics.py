"""Cohorts, decisions, activities; summaries that carry what figures are grouped by, computed anew from raw runs."""

import django.db.models.deletion
from django.db import migrations, models

STATES = [
    ('valid', 'Valid'),
    ('suspect', 'Suspect'),
    ('invalid', 'Invalid'),
    ('quarantined', 'Quarantined'),
]


def wait(apps, schema_editor):
    """The old summaries are gone: every session waits for its new one."""
    apps.get_model('results', 'MeasurementSession').objects.update(summary_algorithm=None)


class Migration(migrations.Migration):

    dependencies = [
        ('devices', '0002_token_rotation'),
        ('fronts', '0001_initial'),
        ('results', '0003_unknown_members'),
    ]

    operations = [
        migrations.DeleteModel(name='SessionSummary'),
        migrations.RunPython(wait, migrations.RunPython.noop),
        migrations.CreateModel(
            name='Cohort',
            fields=[
                ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
                ('backend', models.CharField(max_length=32)),
                ('processor', models.CharField(blank=True, help_text='the OpenCL device that computed', max_length=200)),
                ('stale', models.BooleanField(default=False, help_text='its figures do not know its newest sessions yet')),
                ('device', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='cohorts', to='devices.devicemodel')),
                ('front', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='cohorts', to='fronts.frontversion')),
            ],
            options={
                'indexes': [models.Index(condition=models.Q(('stale', True)), fields=['id'], name='cohort_stale')],
                'constraints': [models.UniqueConstraint(fields=('device', 'front', 'backend', 'processor'), name='cohort_key')],
            },
        ),
        migrations.CreateModel(
            name='Decision',
            fields=[
                ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
                ('at', models.DateTimeField(auto_now_add=True)),
                ('actor', models.CharField(help_text='user name', max_length=150)),
                ('action', models.CharField(choices=[('quarantine', 'Quarantine'), ('release', 'Release')], max_length=16)),
                ('reason', models.CharField(max_length=500)),
                ('run', models.ForeignKey(blank=True, help_text='empty: the whole session', null=True, on_delete=django.db.models.deletion.CASCADE, related_name='decisions', to='results.run')),
                ('session', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='decisions', to='results.measurementsession')),
            ],
            options={
                'ordering': ['-id'],
            },
        ),
        migrations.CreateModel(
            name='DeviceActivity',
            fields=[
                ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
                ('sessions', models.PositiveIntegerField()),
                ('installations', models.PositiveIntegerField()),
                ('last_session_at', models.DateTimeField()),
                ('device', models.OneToOneField(on_delete=django.db.models.deletion.CASCADE, related_name='activity', to='devices.devicemodel')),
            ],
            options={
                'verbose_name_plural': 'device activities',
            },
        ),
        migrations.CreateModel(
            name='SessionSummary',
            fields=[
                ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
                ('algorithm', models.PositiveSmallIntegerField()),
                ('log_ratio', models.FloatField(help_text='natural logarithm of the speedup; empty where no pair is valid', null=True)),
                ('pairs', models.PositiveSmallIntegerField()),
                ('drift', models.FloatField(help_text='largest ratio of the last repeat over the first, frame by frame', null=True)),
                ('ate_max', models.FloatField(help_text="largest ATE of the configuration's runs, m", null=True)),
                ('state', models.CharField(choices=STATES, max_length=16)),
                ('reason', models.CharField(blank=True, help_text='code of the rule that set the state', max_length=64)),
                ('started_at', models.DateTimeField(help_text="the session's")),
                ('day', models.DateField(help_text='of started_at, UTC')),
                ('counted', models.BooleanField(help_text='among the first sessions of its installation and day that have its state')),
                ('baseline', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='+', to='fronts.configuration')),
                ('cohort', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='summaries', to='results.cohort')),
                ('configuration', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='+', to='fronts.configuration')),
                ('installation', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='+', to='devices.installation')),
                ('session', models.ForeignKey(on_delete=django.db.models.deletion.CASCADE, related_name='summaries', to='results.measurementsession')),
            ],
            options={
                'verbose_name_plural': 'session summaries',
                'indexes': [
                    models.Index(fields=['cohort', 'installation', 'day'], name='summary_day'),
                    models.Index(fields=['cohort', 'configuration', 'log_ratio'], name='summary_log_ratio'),
                    models.Index(fields=['started_at'], name='summary_started_at'),
                ],
                'constraints': [models.UniqueConstraint(fields=('session', 'configuration'), name='session_summary_key')],
            },
        ),
        migrations.RemoveIndex(model_name='measurementsession', name='session_device_front'),
        migrations.AddIndex(
            model_name='measurementsession',
            index=models.Index(fields=['device', '-id'], name='session_device_newest'),
        ),
        migrations.AddIndex(
            model_name='measurementsession',
            index=models.Index(fields=['device', 'installation', 'started_at'], name='session_device_activity'),
        ),
        migrations.AddField(
            model_name='run',
            name='fingerprint',
            field=models.BigIntegerField(db_index=True, editable=False, help_text="digest of the frames' times, where they vary enough to be nobody else's", null=True),
        ),
        migrations.AlterField(
            model_name='devicespeedup',
            name='state',
            field=models.CharField(choices=STATES, help_text='suspect: no valid session, only suspect ones', max_length=16),
        ),
        migrations.AlterField(
            model_name='run',
            name='state',
            field=models.CharField(choices=STATES, max_length=16),
        ),
    ]
