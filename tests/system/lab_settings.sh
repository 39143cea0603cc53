# SPDX-License-Identifier: Apache-2.0
# For a shell of `ontime lab`: a run that changes settings to its end, and one all of whose processes are killed; what
# other programs (ps, ethtool, cat) then see of the interrupts' threads, ksoftirqd, NAPI and the NICs. See test_lab.py.
cat >/tmp/tuned.yaml <<'YAML'
hosts: namespaces
defaults: {transport: udp, duration: 3 s, realtime: on}
runs:
  - id: tuned
    kernel: {irq-threads: 90, ksoftirqd: 60, threaded-napi: on, napi-threads: 61, gro: off, coalescing: rx-usecs=10}
YAML
see() {
  ps -eLo comm:20,cls,rtprio --no-headers | grep -E '^(irq/[0-9]+-eth|ksoftirqd|napi/)' | sort -u |
    while read -r thread policy priority; do echo "$1 $thread=$policy $priority"; done
  local end place nic
  for end in controller=eth0 component=eth1; do
    place=ontime-${end%=*} nic=${end#*=}
    if [ ! -e "/run/netns/$place" ]; then
      place=
      until [ -e "/sys/class/net/$nic" ]; do sleep 0.1; done # it comes back some time after its namespace went
    fi
    for word in "threaded $(${place:+ip netns exec $place} cat "/sys/class/net/$nic/threaded")" \
      "$(${place:+ip netns exec $place} ethtool -c "$nic" | grep rx-usecs:)" \
      "$(${place:+ip netns exec $place} ethtool -k "$nic" | grep generic-receive-offload:)"; do
      echo "$1 $nic ${word%%[: ]*}=${word##*[[:space:]]}"
    done
  done
}
measure() { TERM=dumb ontime run --only-measure --cable eth0,eth1 --results "/tmp/$1" /tmp/tuned.yaml 2>&1; echo "$1 ended $?"; }
measures() {
  until ps -eo args | grep -q '[o]ntime agent'; do sleep 0.1; done
  sleep 1.5
}

see before
measure whole &
measures
see during
wait
see after
measure cut &
measures
kill -9 $(ps -C ontime -o pid=)
wait
see killed
ontime tune revert
echo "revert ended $?"
see reverted
echo "left $(ip netns list)"
