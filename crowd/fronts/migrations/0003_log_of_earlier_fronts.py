from django.db import migrations


def log_what_was_published(apps, schema_editor):
    """Fronts that were published before there was a log: when, with which content, by somebody."""
    entries = apps.get_model('fronts', 'AuditEntry').objects
    for front in apps.get_model('fronts', 'FrontVersion').objects.filter(audit__isnull=True).exclude(
        state='draft'
    ).order_by('published_at'):
        steps = [('published', 'draft', 'published', front.published_at)]
        if front.state == 'retired':
            steps.append(('retired', 'published', 'retired', front.retired_at))
        for action, before, after, at in steps:
            entry = entries.create(
                actor='unknown', action=action, slug=front.slug, front=front, from_state=before,
                to_state=after, digest=front.digest, note='before the log was kept',
            )
            if at is not None:
                entries.filter(pk=entry.pk).update(at=at)


def send_reviews_back(apps, schema_editor):
    """Before there were reviews a front was a draft or published: nothing else fits the former constraint."""
    apps.get_model('fronts', 'FrontVersion').objects.filter(state='in-review').update(state='draft')


class Migration(migrations.Migration):

    dependencies = [
        ('fronts', '0002_publishing'),
    ]

    operations = [
        migrations.RunPython(log_what_was_published, send_reviews_back),
    ]
