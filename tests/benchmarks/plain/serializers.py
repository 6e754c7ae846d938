"""ModelSerializers with nested writes."""

from typing import Any

from rest_framework import serializers

from tests.benchmarks.plain.models import Run, Session, Submission

FRAMES = 100


class Microseconds(serializers.IntegerField):
    """One time of a series."""

    def __init__(self) -> None:
        super().__init__(min_value=0, max_value=2**32 - 1)


class RunSerializer(serializers.ModelSerializer):
    """A run with its series."""

    frame_us = serializers.ListField(child=Microseconds(), min_length=FRAMES, max_length=FRAMES)
    stages_us = serializers.DictField(child=serializers.ListField(child=Microseconds()))
    tracked = serializers.ListField(child=serializers.BooleanField(allow_null=True))

    class Meta:
        model = Run
        exclude = ["session"]
        extra_kwargs = {"id": {"required": True}}


class SessionSerializer(serializers.ModelSerializer):
    """A session with its runs."""

    runs = RunSerializer(many=True)

    class Meta:
        model = Session
        exclude = ["submission"]
        extra_kwargs = {"id": {"required": True}}


class SubmissionSerializer(serializers.ModelSerializer):
    """A submission with its sessions; `installation` and `idempotency_key` come with save()."""

    sessions = SessionSerializer(many=True)

    class Meta:
        model = Submission
        exclude = ["installation", "idempotency_key"]

    def create(self, validated_data: dict[str, Any]) -> Submission:
        sessions = validated_data.pop("sessions")
        submission = Submission.objects.create(**validated_data)
        for session in sessions:
            runs = session.pop("runs")
            stored = Session.objects.create(submission=submission, **session)
            Run.objects.bulk_create(Run(session=stored, **run) for run in runs)
        return submission
