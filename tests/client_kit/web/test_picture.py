"""The picture of the model is the one that Python draws."""

from __future__ import annotations

from typing import Any

import numpy as np

from slam.reports.render import shade
from slam.system import View

SHADE = """async ({ vertices, normals, eye }) => {
    const { shade } = await import("/measure/picture.js");
    return Array.from(shade(Float32Array.from(vertices), Float32Array.from(normals), eye));
}"""


def test_a_picture_is_shaded_as_python_shades_it(web_page: Any) -> None:
    random = np.random.default_rng(3)
    vertices = random.uniform(0, 4, (9, 12, 3)).astype(np.float32)
    normals = random.normal(size=(9, 12, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    normals[:3] = 0
    eye = np.array([1.0, 2.0, 0.5], np.float32)
    vertices[4, 4] = eye  # no direction leads to it
    planes = {
        name: np.moveaxis(image, -1, 0).ravel().tolist()
        for name, image in (("vertices", vertices), ("normals", normals))
    }

    found = np.array(web_page.evaluate(SHADE, planes | {"eye": eye.tolist()})).reshape(9, 12, 4)

    expected = shade(View(vertices, normals, eye))
    assert abs(found[..., :3] - expected.astype(int)).max() <= 1
    assert (found[..., 3] == 255).all()
    assert len(np.unique(found[3:], axis=0)) > 1
