from django.db import migrations, models


class Migration(migrations.Migration):
    """The log takes entries about anything and moves, with its rows, to an application of its own."""

    dependencies = [
        ('fronts', '0004_intake_policy'),
    ]

    operations = [
        migrations.RemoveIndex(model_name='auditentry', name='audit_entry_slug'),
        migrations.RenameField(model_name='auditentry', old_name='slug', new_name='subject'),
        migrations.AlterField(
            model_name='auditentry', name='subject', field=models.CharField(max_length=200)
        ),
        migrations.AlterField(
            model_name='auditentry', name='action', field=models.CharField(max_length=64)
        ),
        migrations.AddIndex(
            model_name='auditentry', index=models.Index(fields=['subject'], name='audit_entry_subject')
        ),
        migrations.SeparateDatabaseAndState(
            database_operations=[migrations.AlterModelTable('auditentry', 'audit_auditentry')],
            state_operations=[migrations.DeleteModel('auditentry')],
        ),
    ]
