"""Two addresses: POST /api/v1/submissions, and POST /parse-only, which stores nothing."""

import gzip
import hashlib
from functools import partial
from io import BytesIO
from typing import Any

from django.db import transaction
from rest_framework.authentication import BaseAuthentication
from rest_framework.exceptions import AuthenticationFailed
from rest_framework.parsers import JSONParser
from rest_framework.request import Request
from rest_framework.response import Response
from rest_framework.views import APIView

from crowd.celery import app
from crowd.devices.models import Installation
from tests.benchmarks.plain.models import Submission
from tests.benchmarks.plain.serializers import SubmissionSerializer


class GzippedJSONParser(JSONParser):
    """JSON, inflated."""

    def parse(self, stream: Any, media_type: Any = None, parser_context: Any = None) -> Any:
        return super().parse(BytesIO(gzip.decompress(stream.read())), media_type, parser_context)


class TokenAuthentication(BaseAuthentication):
    """`Authorization: Bearer TOKEN`."""

    def authenticate(self, request: Request) -> tuple[None, Installation]:
        digest = hashlib.sha256(request.headers["Authorization"].partition(" ")[2].encode()).hexdigest()
        installation = Installation.objects.filter(token_sha256=digest).first()
        if installation is None:
            raise AuthenticationFailed
        return None, installation


class SubmissionsView(APIView):
    """Measured sessions come in."""

    authentication_classes = [TokenAuthentication]
    parser_classes = [GzippedJSONParser]

    @transaction.atomic
    def post(self, request: Request) -> Response:
        key = {"installation": request.auth, "idempotency_key": request.headers["Idempotency-Key"]}
        if Submission.objects.filter(**key).exists():
            return Response({"status": "duplicate"})
        serializer = SubmissionSerializer(data=request.data)
        serializer.is_valid(raise_exception=True)
        submission = serializer.save(**key)
        for session in serializer.validated_data["sessions"]:
            transaction.on_commit(partial(app.send_task, "plain.summarise", [str(session["id"])]))
        items = [
            {"id": run["id"], "status": "accepted", "code": None}
            for session in request.data["sessions"]
            for run in session["runs"]
        ]
        return Response({"submission_id": submission.pk, "items": items}, status=202)


class ParseOnlyView(APIView):
    """The least that an intake on these libraries costs: the body is inflated, parsed and answered."""

    authentication_classes = []
    parser_classes = [GzippedJSONParser]

    def post(self, request: Request) -> Response:
        return Response({"sessions": len(request.data["sessions"])}, status=202)
