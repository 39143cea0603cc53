# SPDX-License-Identifier: Apache-2.0
import argparse
import os
import sys

from ros2cli.command import CommandExtension


class OntimeCommand(CommandExtension):
    """Measure whether messages arrive on time."""

    def add_arguments(self, parser, cli_name):
        parser.prefix_chars = ''  # every word belongs to ontime, -h too
        parser.add_argument('words', nargs=argparse.REMAINDER)

    def main(self, *, parser, args):
        try:
            # In the place of this process: signals and the exit code are ontime's own.
            os.execvp('ontime', ['ontime', *args.words])
        except OSError as error:
            print(f'ros2 ontime: the program ontime does not start: {error.strerror}. '
                  'Source the workspace that has it, or add its folder to PATH.', file=sys.stderr)
            return 3
