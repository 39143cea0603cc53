# SPDX-License-Identifier: Apache-2.0
"""The component's end: ros2 launch ontime_ros2 pong.launch.py priority:=80 lock_memory:=true"""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PARAMETERS = {
    'priority': ('0', 'SCHED_FIFO priority of the threads that a message passes through; 0: ordinary threads'),
    'background_priority': ('0', "SCHED_FIFO priority of the middleware's other threads; 0: ordinary threads"),
    'lock_memory': ('false', 'keep all memory from being paged out'),
    'payload': ('65536', 'bytes that are answered without allocating'),
    'reliability': ('best-effort', 'best-effort or reliable'),
    'history': ('keep-last', 'keep-last or keep-all'),
    'depth': ('1', 'messages that history keep-last keeps'),
}
TOPICS = {
    'ping_topic': ('ping', 'what is answered'),
    'pong_topic': ('pong', 'where it is answered'),
}


def generate_launch_description():
    arguments = [DeclareLaunchArgument(name, default_value=default, description=description)
                 for name, (default, description) in {**PARAMETERS, **TOPICS}.items()]
    namespace = DeclareLaunchArgument('namespace', default_value='', description='of node and topics')
    pong = Node(package='ontime_ros2', executable='pong', namespace=LaunchConfiguration('namespace'),
                parameters=[{name: LaunchConfiguration(name) for name in PARAMETERS}],
                remappings=[(default, LaunchConfiguration(name)) for name, (default, _) in TOPICS.items()],
                output='screen')
    return LaunchDescription([*arguments, namespace, pong])
