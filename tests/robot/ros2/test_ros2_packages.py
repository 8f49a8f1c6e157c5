"""The ROS 2 packages in the folder `ros2`: manifests, parameters, launch file, README and build."""

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest

from texclass import __version__

yaml = pytest.importorskip("yaml")  # pre-commit brings it
PACKAGES = Path(__file__).resolve().parents[3] / "ros2"
NODE = PACKAGES / "texclass_ros"
README = PACKAGES / "README.md"
SYSTEM_PYTHON = "/usr/bin/python3"


@pytest.fixture
def parameters(node_module):
    return node_module.PARAMETERS


def test_the_parameter_file_lists_every_parameter_with_its_default(parameters):
    content = yaml.safe_load((NODE / "config" / "params.yaml").read_text(encoding="utf-8"))
    values = content["/**"]["ros__parameters"]
    assert values == {name: default for name, (default, _) in parameters.items()}
    assert {name: type(value) for name, value in values.items()} == {
        name: type(default) for name, (default, _) in parameters.items()
    }


def test_the_readme_lists_every_parameter(parameters):
    rows = re.findall(r"^\| `(\w+)` \| `(.*?)` \| (.*) \|$", README.read_text(encoding="utf-8"), re.M)
    assert rows == [(name, shown(default), text) for name, (default, text) in parameters.items()]


def shown(default):
    """Return a value as in YAML."""
    return '""' if default == "" else str(default).lower() if isinstance(default, bool) else str(default)


def test_settings_of_the_recognition_reach_the_session(node_module):
    values = {name: default for name, (default, _) in node_module.PARAMETERS.items()}
    changes = {"window_s": 0.5, "hop_s": 0.1, "evidence": "majority", "confidence": 0.8, "forget_s": 2.0}
    changes |= {"stop_when_sure": True, "always_in_contact": True}
    settings = node_module.online_settings(values | changes)
    assert {name: getattr(settings, name) for name in changes} == changes
    assert node_module.online_settings(values).window_s is None


@pytest.mark.parametrize("name", ["texclass_msgs", "texclass_ros"])
def test_manifests_have_the_version_of_texclass_and_a_build_type(name):
    root = ElementTree.parse(PACKAGES / name / "package.xml").getroot()
    assert (root.tag, root.get("format"), root.findtext("name")) == ("package", "3", name)
    assert root.findtext("version") == __version__
    assert root.findtext("license") == "MIT"
    build_type = {"texclass_msgs": "ament_cmake", "texclass_ros": "ament_python"}[name]
    assert root.findtext("export/build_type") == build_type
    if name == "texclass_msgs":
        assert root.findtext("member_of_group") == "rosidl_interface_packages"


@pytest.mark.parametrize("name", ["texclass_msgs", "texclass_ros"])
def test_manifests_are_valid_for_the_build_tools_of_ros(name):
    code = "import sys; from catkin_pkg.package import parse_package; parse_package(sys.argv[1]).validate()"
    if (
        not Path(SYSTEM_PYTHON).exists()
        or subprocess.run(
            [SYSTEM_PYTHON, "-c", "import catkin_pkg"], capture_output=True, check=False, env={}
        ).returncode
    ):
        pytest.skip("catkin_pkg is not installed (Debian: python3-catkin-pkg)")
    result = subprocess.run(
        [SYSTEM_PYTHON, "-W", "error", "-c", code, PACKAGES / name / "package.xml"],
        capture_output=True,
        text=True,
        check=False,
        env={},
    )
    assert not result.returncode, result.stderr


def test_the_manifest_lists_every_package_that_is_imported():
    paths = [*NODE.glob("texclass_ros/*.py"), *NODE.glob("launch/*.py")]
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in paths]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    names += [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    imported = {name.partition(".")[0] for name in names} - {"texclass", "texclass_ros"}
    from texclass.robot.ros_messages import LIVE

    imported |= {name.partition("/")[0] for name in LIVE} | {"builtin_interfaces"}
    root = ElementTree.parse(NODE / "package.xml").getroot()
    assert {element.text for element in root.findall("exec_depend")} == imported


def test_the_launch_file_configures_the_node_and_activates_it(monkeypatch):
    launch = MagicMock()
    for name in (
        "launch",
        "launch.actions",
        "launch.conditions",
        "launch.events",
        "launch.substitutions",
        "launch_ros",
        "launch_ros.actions",
        "launch_ros.event_handlers",
        "launch_ros.events",
        "launch_ros.events.lifecycle",
        "launch_ros.parameter_descriptions",
        "launch_ros.substitutions",
        "lifecycle_msgs",
        "lifecycle_msgs.msg",
    ):
        monkeypatch.setitem(sys.modules, name, launch)
    content = runpy.run_path(str(NODE / "launch" / "texclass.launch.py"))
    content["generate_launch_description"]()
    node = launch.LifecycleNode.call_args.kwargs
    assert (node["package"], node["executable"]) == ("texclass_ros", "texclass_node")
    assert "texclass_node = " in (NODE / "setup.py").read_text(encoding="utf-8")
    states = launch.OnStateTransition.call_args.kwargs
    assert (states["start_state"], states["goal_state"]) == ("configuring", "inactive")
    ids = [call.kwargs["transition_id"] for call in launch.ChangeState.call_args_list]
    assert ids == [launch.Transition.TRANSITION_ACTIVATE, launch.Transition.TRANSITION_CONFIGURE]
    names = {call.args[0] for call in launch.DeclareLaunchArgument.call_args_list}
    listed = re.findall(r"^\| `(\w+):=` ", README.read_text(encoding="utf-8"), re.M)
    assert names == set(content["ARGUMENTS"]) == set(listed)


def test_colcon_builds_the_package_of_the_node(tmp_path):
    if shutil.which("colcon", path="/usr/bin") is None:
        pytest.skip("colcon is not installed (Debian: colcon python3-colcon-ros and its extensions)")
    shutil.copytree(NODE, tmp_path / "src" / "texclass_ros")
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "LANG": os.environ.get("LANG", "C.UTF-8")}
    command = ["/usr/bin/colcon", "build", "--packages-select", "texclass_ros"]
    result = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    if "unrecognized arguments" in result.stderr:
        pytest.skip("colcon lacks extensions (Debian: python3-colcon-package-selection)")
    assert not result.returncode, result.stdout + result.stderr
    installed = tmp_path / "install" / "texclass_ros"
    for name in ("config/params.yaml", "launch/texclass.launch.py", "package.xml"):
        assert (installed / "share" / "texclass_ros" / name).is_file()
    script = (installed / "lib" / "texclass_ros" / "texclass_node").read_text(encoding="utf-8")
    assert script.startswith("#!/usr/bin/env python3")
