import uuid
from django.db import migrations, models


class Migration(migrations.Migration):

    dependencies = [
        ('results', '0001_initial'),
    ]

    operations = [
        migrations.CreateModel(
            name='Tombstone',
            fields=[
                ('id', models.UUIDField(default=uuid.uuid4, editable=False, primary_key=True, serialize=False)),
                ('kind', models.CharField(choices=[('run', 'Run'), ('session', 'Session'), ('installation', 'Installation')], max_length=12)),
                ('id_sha256', models.CharField(blank=True, help_text='SHA-256 of the id that the run or session had; empty for an installation', max_length=64)),
                ('erased_at', models.DateTimeField(db_index=True)),
            ],
            options={
                'ordering': ['erased_at', 'id'],
            },
        ),
        migrations.CreateModel(
            name='Export',
            fields=[
                ('id', models.BigAutoField(auto_created=True, primary_key=True, serialize=False, verbose_name='ID')),
                ('started_at', models.DateTimeField(db_index=True)),
                ('touched_at', models.DateTimeField(help_text='while it is being written: when that went on last')),
                ('published_at', models.DateTimeField(null=True)),
                ('withdrawn_at', models.DateTimeField(help_text='something in it was erased: its files are deleted', null=True)),
                ('files', models.JSONField(default=list, help_text='name, table, format, rows, bytes, sha256')),
            ],
            options={
                'ordering': ['-started_at', '-id'],
            },
        ),
    ]
