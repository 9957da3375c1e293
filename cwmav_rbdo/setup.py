# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

from setuptools import find_packages, setup

name = "cwmav_rbdo"


def files(folder: str) -> list[str]:
    return sorted(str(path) for path in Path(folder).glob("*.yaml" if "config" in folder else "*.py"))


setup(
    name=name,
    version="0.1.0",
    description="Reliability-based optimisation of clapping-wing control settings",
    license="Apache-2.0",
    maintainer="cwmav maintainers",
    maintainer_email="cwmav@users.noreply.github.com",
    packages=find_packages(include=[name, f"{name}.*"]),
    package_data={"": ["*.csv", "*.html", "*.json", "*.npz", "*.svg", "*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
        (f"share/{name}/config", files("config") + files(f"{name}/config")),
        (f"share/{name}/launch", files("launch")),
    ],
    install_requires=["setuptools"],
    python_requires=">=3.11",
    zip_safe=False,
    entry_points={
        "console_scripts": [
            f"optimiser_node = {name}.nodes.optimiser_node:main",
            f"cwmav-rbdo = {name}.cli:main",
        ]
    },
)
