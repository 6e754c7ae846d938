import django.core.validators
from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('fronts', '0003_log_of_earlier_fronts'),
    ]

    operations = [
        migrations.CreateModel(
            name='IntakePolicy',
            fields=[
                ('id', models.PositiveSmallIntegerField(default=1, editable=False, primary_key=True, serialize=False)),
                ('accepting', models.BooleanField(blank=True, choices=[(None, 'as FRONTRUNNER_ACCEPTING says'), (True, 'are taken'), (False, 'are not taken')], help_text='If closed, clients keep their results and try again later.', null=True, verbose_name='measurements')),
                ('message', models.CharField(blank=True, help_text='told to people whose clients are turned away: why, how long', max_length=300)),
                ('minimum_app_version', models.CharField(blank=True, help_text='Older clients must update. Empty: the value of FRONTRUNNER_MINIMUM_APP_VERSION.', max_length=32, validators=[django.core.validators.RegexValidator('\\A[0-9]{1,6}(\\.[0-9]{1,6}){0,4}\\Z', 'numbers with dots, as 1.2.0')])),
                ('changed_at', models.DateTimeField(auto_now=True)),
            ],
            options={
                'verbose_name': 'intake policy',
                'verbose_name_plural': 'intake policy',
                'constraints': [models.CheckConstraint(condition=models.Q(('pk', 1)), name='intake_policy_only')],
            },
        ),
    ]
