"""A participant as the API sees one: a token, and requests with it."""

import gzip
import json
import uuid
from dataclasses import dataclass
from typing import Any

from django.test import Client

API = "/api/v1"


@dataclass(frozen=True)
class Participant:
    """Sends requests with its token through Django's test client; answers come back as they are."""

    client: Client
    token: str
    installation_id: str

    @property
    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}

    def submit(
        self, document: Any, key: str | None = None, path: str = "/submissions", **headers: str
    ) -> Any:
        """POST a document, or bytes as they are."""
        body = document if isinstance(document, bytes) else json.dumps(document).encode()
        return self.client.post(
            f"{API}{path}",
            data=body,
            content_type="application/json",
            headers={**self.headers, "Idempotency-Key": key or str(uuid.uuid4()), **headers},
        )

    def submit_gzipped(self, body: bytes, **headers: str) -> Any:
        return self.submit(gzip.compress(body), **{"Content-Encoding": "gzip", **headers})

    def get(self, path: str) -> Any:
        return self.client.get(f"{API}{path}", headers=self.headers)

    def own_data(self) -> Any:
        """Everything that is kept of it."""
        response = self.get("/me/data")
        assert response.status_code == 200, response.getvalue()
        return json.loads(response.getvalue())

    def delete(self, path: str) -> Any:
        return self.client.delete(f"{API}{path}", headers=self.headers)
