"""Start the node, configure it, and activate it once it is configured."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition

ARGUMENTS = {
    "model": "Model file written by `texclass train`.",
    "topic": "Topic of the sensor, to which the topic `imu` of the node is remapped.",
    "params_file": "File of the other parameters.",
    "namespace": "Namespace of the node.",
    "autostart": "Whether to configure and activate the node.",
}


def generate_launch_description():
    """Return the node with its parameters and transitions."""
    defaults = {
        "topic": "imu",
        "params_file": PathJoinSubstitution([FindPackageShare("texclass_ros"), "config", "params.yaml"]),
        "namespace": "",
        "autostart": "true",
    }
    node = LifecycleNode(
        package="texclass_ros",
        executable="texclass_node",
        name="texclass",
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[
            LaunchConfiguration("params_file"),
            {"model": ParameterValue(LaunchConfiguration("model"), value_type=str)},
        ],
        remappings=[("imu", LaunchConfiguration("topic"))],
    )

    def change_state(transition):
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition),
            condition=IfCondition(LaunchConfiguration("autostart")),
        )

    activate_when_configured = RegisterEventHandler(
        OnStateTransition(
            target_lifecycle_node=node,
            start_state="configuring",
            goal_state="inactive",
            entities=[change_state(Transition.TRANSITION_ACTIVATE)],
        )
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=defaults.get(name), description=description)
                for name, description in ARGUMENTS.items()
            ),
            activate_when_configured,
            node,
            change_state(Transition.TRANSITION_CONFIGURE),
        ]
    )
