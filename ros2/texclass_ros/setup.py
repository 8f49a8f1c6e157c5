"""Build of the ROS 2 package texclass_ros (ament_python)."""

from glob import glob

from setuptools import setup

NAME = "texclass_ros"

setup(
    name=NAME,
    version="0.3.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
        (f"share/{NAME}/config", glob("config/*.yaml")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The texclass developers",
    maintainer_email="texclass@example.org",
    description="Lifecycle node that classifies the surface under a tool or robot from its acceleration.",
    license="MIT",
    entry_points={"console_scripts": [f"texclass_node = {NAME}.node:main"]},
)
