#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs a command that has a /run and a network, and so journals and network namespaces, of its own: others may run beside it.

  own_machine.py COMMAND…        without root the command runs where it is

The kernel stays the same for all: its settings, CPUs, control groups and traces.
"""
import ctypes
import os
import subprocess
import sys

CLONE_NEWNS, CLONE_NEWNET = 0x00020000, 0x40000000  # as in <linux/sched.h>


def own_mounts(also=0):
    """Of this process, and of what it starts: they end with these, whatever ends them."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNS | also) != 0:
        raise OSError(ctypes.get_errno(), "no namespaces")
    subprocess.run(["mount", "--make-rprivate", "/"], check=True)


def enter():
    """This process, and what it starts."""
    own_mounts(CLONE_NEWNET)
    subprocess.run(["mount", "-t", "tmpfs", "-o", "mode=755", "tmpfs", "/run"], check=True)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)


if __name__ == "__main__":
    if os.geteuid() == 0:
        enter()
    os.execvp(sys.argv[1], sys.argv[1:])
