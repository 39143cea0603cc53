# SPDX-License-Identifier: Apache-2.0
"""An sshd of one's own in a network namespace, and a client who is let in, with keys made for both."""

import contextlib
import os
import pathlib
import re
import shutil
import subprocess
import time

PORT = 2222
KEYS = ("host_key", "user_key", "other_key")  # "other": of a user who is not let in


def make_keys(folder):
    for name in KEYS:
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / name], check=True)
    shutil.copy(folder / "user_key.pub", folder / "authorized_keys")


@contextlib.contextmanager
def serving(folder, namespace, temporary, more_users=""):
    """Gives the process that listens; its own view of the files has more users, and who comes has that temporary folder."""
    # Without this machine's ~/.bashrc: what it starts in each session would be measured and waited for, too.
    users = re.sub("^(root:.*):/root:", rf"\1:{folder}:", pathlib.Path("/etc/passwd").read_text(), flags=re.MULTILINE)
    (folder / "passwd").write_text(users + more_users)
    (folder / "sshd_config").write_text(f"""
        Port {PORT}
        HostKey {folder}/host_key
        PidFile {folder}/sshd.pid
        AuthorizedKeysFile {folder}/authorized_keys
        PermitRootLogin prohibit-password
        PasswordAuthentication no
        KbdInteractiveAuthentication no
        UsePAM no
        StrictModes no
        SetEnv TMPDIR={temporary} ONTIME_TEST={temporary}
        """)
    made = not os.path.exists("/run/sshd")
    os.makedirs("/run/sshd", exist_ok=True)
    script = f"mount --bind {folder}/passwd /etc/passwd && exec /usr/sbin/sshd -D -E {folder}/log -f {folder}/sshd_config"
    sshd = subprocess.Popen(["ip", "netns", "exec", namespace, "sh", "-c", script])
    try:
        end = time.monotonic() + 120
        while not (folder / "sshd.pid").exists():
            assert sshd.poll() is None and time.monotonic() < end, (folder / "log").read_text()
            time.sleep(0.05)
        yield sshd
    finally:
        sshd.terminate()
        sshd.wait()
        (folder / "sshd.pid").unlink(missing_ok=True)
        if made:
            os.rmdir("/run/sshd")


def configure_client(folder, own, host="robot", **changes):
    """Of that host, in a folder of the client's own."""
    settings = {"Port": PORT, "User": "root", "IdentityFile": folder / "user_key", "IdentitiesOnly": "yes",
                "UserKnownHostsFile": own / "known_hosts", "GlobalKnownHostsFile": "/dev/null", **changes}
    (own / "ssh_config").write_text(f"Host {host}\n" + "".join(f"{key} {value}\n" for key, value in settings.items()))


def make_client(folder, own, addresses):
    """Gives the folder of an `ssh` that reads this configuration and knows these hosts."""
    known = ",".join(f"[{address}]:{PORT}" for address in addresses)
    (own / "known_hosts").write_text(f"{known} {(folder / 'host_key.pub').read_text()}")
    ssh = own / "bin" / "ssh"
    ssh.parent.mkdir()
    ssh.write_text(f'#!/bin/sh\nexec /usr/bin/ssh -F {own}/ssh_config "$@"\n')
    ssh.chmod(0o755)
    return ssh.parent
