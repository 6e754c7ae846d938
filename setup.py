"""The packages of an installation and their data. `fixtures/` and a built guide go inside `frontrunner`."""

from setuptools import find_packages, setup

PACKAGES = ["frontrunner*", "slam*", "pareto*", "client_kit*", "crowd*", "wire*", "groundwork*"]
WEB = ["*.js", "*.css", "*.svg", "*.png", "*.webmanifest", "templates/**/*", "static/**/*", "locale/**/*"]

setup(
    packages=[*find_packages(include=PACKAGES), "client_kit.web", "frontrunner.fixtures"],
    package_dir={"frontrunner.fixtures": "fixtures"},
    package_data={
        "": ["*.json", "tables/*.toml", "kernels/*", "*.c", "*.h", *WEB],
        "frontrunner": ["guide/**/*"],
        "frontrunner.fixtures": ["fronts/*", "explorations/*", "sequences/**/*", "surfaces/*"],
    },
)
