# SPDX-License-Identifier: Apache-2.0
"""The controller's end, measured by ontime: ros2 launch ontime_ros2 ping.launch.py period:='5 ms' results:=robot.ontime"""
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

# Launch argument: (flag of `ontime ping`, what). One that is left empty is left to ontime.
FLAGS = {
    'period': ('--period', 'of sending, such as "10 ms"'),
    'duration': ('--duration', 'of sending, such as "1 min"'),
    'payload': ('--payload', 'such as "500 B"'),
    'reliability': ('--reliability', 'best-effort or reliable'),
    'history': ('--history', 'keep-last or keep-all'),
    'depth': ('--depth', 'messages that history keep-last keeps'),
    'priority': ('--priority', 'SCHED_FIFO priority of the threads that a message passes through'),
    'interface': ('--interface', 'the link under test'),
    'domain': ('--domain', 'instead of that of ROS_DOMAIN_ID'),
    'namespace': ('--namespace', 'of node and topics'),
    'ping_topic': ('--ping-topic', 'what the controller writes'),
    'pong_topic': ('--pong-topic', 'what the component answers on'),
    'results': ('--results', 'file that keeps every sample'),
}


def ping(context):
    def value(name):
        return LaunchConfiguration(name).perform(context)

    command = ['ontime', 'ping', '--transport', 'ros2']
    for name, (flag, _) in FLAGS.items():
        if value(name):
            command += [flag, value(name)]
    return [ExecuteProcess(cmd=command, output='screen')]


def generate_launch_description():
    arguments = [DeclareLaunchArgument(name, default_value='', description=what) for name, (_, what) in FLAGS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=ping)])
