import django.db.models.deletion
from django.db import migrations, models


class Migration(migrations.Migration):
    """The table exists: fronts 0005 renamed the one that held the log of fronts."""

    initial = True

    dependencies = [
        ('fronts', '0005_audit_log_for_everything'),
    ]

    operations = [
        migrations.SeparateDatabaseAndState(
            state_operations=[
                migrations.CreateModel(
                    name='AuditEntry',
                    fields=[
                        ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
                        ('at', models.DateTimeField(auto_now_add=True)),
                        ('actor', models.CharField(help_text='user name, or where the command was given', max_length=150)),
                        ('action', models.CharField(max_length=64)),
                        ('subject', models.CharField(help_text="a front's name, or a kind and a name, as in exploration 7", max_length=200)),
                        ('from_state', models.CharField(blank=True, max_length=16)),
                        ('to_state', models.CharField(blank=True, max_length=16)),
                        ('digest', models.CharField(blank=True, help_text="of a front's content at that time", max_length=64)),
                        ('note', models.TextField(blank=True)),
                        ('front', models.ForeignKey(blank=True, null=True, on_delete=django.db.models.deletion.PROTECT, related_name='audit', to='fronts.frontversion')),
                    ],
                    options={
                        'verbose_name_plural': 'audit log',
                        'ordering': ['-id'],
                        'indexes': [models.Index(fields=['subject'], name='audit_entry_subject')],
                    },
                ),
            ],
        ),
    ]
